"""`lookonce tune`."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lookonce.cli.compare_scenes import DetectionsOption, DetectionSource, ModelOption, check_given, labels_of
from lookonce.cli.evaluated_truth import BENCHMARKS, TrueSequence
from lookonce.cli.evaluation_files import write_text
from lookonce.cli.stages import StageScreen
from lookonce.cli.track_detections import tracker_without_descriptors
from lookonce.cli.track_run import SHIPPED_MODEL
from lookonce.cli.tuning_data import TuningData, find_scenes, hold_out, open_all
from lookonce.cli.tuning_screen import TunedFigures, print_tuned, toml_lines
from lookonce.errors import ConfigError
from lookonce.make.given_boxes import BoxDescriber
from lookonce.model import Model, available_cpus
from lookonce.output.folder import prepare_output_folder
from lookonce.pipeline import detector_score, tracker_for
from lookonce.tracking import DefaultConfig, TrackerConfig
from lookonce.tracking.settings import ChosenTracker, choose_tracker, tracker_settings_toml
from lookonce.tuning.ranges import SearchRange, choose_ranges, lowest_score
from lookonce.tuning.scoring import OBJECTIVES, Scorer
from lookonce.tuning.trials import TrialFile
from lookonce.video.opening import one_line

if TYPE_CHECKING:
    from lookonce.tuning.searching import Search

__all__ = ["tune_command"]

_EXAMPLES = """
[bold]Examples[/bold]

  Search on one sequence; the second half of its frames is held out:

  lookonce tune MOT17-02/ -m model+id.onnx --classes person

  On detections of your own, with a model's descriptors at their boxes (without -m: boxes only):

  lookonce tune MOT17-02/ --detections MOT17-02/det/det.txt -m street

  Several sequences and frame rates, one sequence held out, an hour:

  lookonce tune data/ -m model+id.onnx --every 1,2,4 --holdout gate-3 --trials 1000 --minutes 60

  What came of it:

  lookonce track gate.mp4 -m model+id.onnx --tracker runs/tune/tuned.toml
"""

_TUNED, _TRIALS = "tuned.toml", "trials.jsonl"
_EVERY = re.compile(r"[1-9][0-9]{0,5}(,[1-9][0-9]{0,5})*")
_MAX_TRIALS = 100_000

_Data = Annotated[
    list[Path], typer.Argument(metavar="DATA", help="Labelled sequences with pictures, or folders of them.")
]
_Output = Annotated[Path, typer.Option("-o", "--output", help="Folder for tuned.toml, the trials and the detections.")]
_Preset = Annotated[str, typer.Option(help="Where to begin: default, iou, paper, or a TOML file.")]
_Objective = Annotated[str, typer.Option(help=f"What to make large: {', '.join(OBJECTIVES)}.")]
_Every = Annotated[str, typer.Option(metavar="1,2,4", help="Frame rates, every n-th frame: the mean over them counts.")]
_Holdout = Annotated[
    list[str] | None,
    typer.Option(help="A sequence that is only scored; may be repeated.", show_default="second half of each"),
]
_Only = Annotated[
    str, typer.Option(help="Search these settings or tables only, such as motion,memory_s.", show_default="all")
]
_Trials = Annotated[int, typer.Option(help="How many settings to try in all.", min=1, max=_MAX_TRIALS)]
_Minutes = Annotated[float | None, typer.Option(help="Begin no trial after so long.", min=0, show_default="no limit")]
_Seed = Annotated[int, typer.Option(help="Of every random choice.", min=0, max=2**32 - 1)]
_Classes = Annotated[
    str,
    typer.Option(help="Keep a model's detections (and truth, where it has them) of these classes.", show_default="all"),
]
_Frames = Annotated[Path | None, typer.Option(help="Pictures of a single sequence.", show_default="as its layout says")]
_Fps = Annotated[float | None, typer.Option(help="Of folders of pictures.", show_default="as stated there, or 25")]
_Benchmark = Annotated[str, typer.Option(help=f"Follow the rules of {', '.join(BENCHMARKS)}.", show_default="none")]
_Resume = Annotated[bool, typer.Option("--resume", help="Go on with an earlier search.")]
_Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an earlier search; detections stay.")]
_Provider = Annotated[str, typer.Option(help="Where the model runs: cpu, cuda or openvino.")]
_Threads = Annotated[int | None, typer.Option(help="Threads for one inference.", show_default="all", min=1)]


@dataclass(frozen=True, slots=True)
class _Asked:
    """What is asked for, checked."""

    begin: ChosenTracker
    objective: str
    every: tuple[int, ...]
    only: tuple[str, ...]
    trials: int
    minutes: float | None
    seed: int
    classes: tuple[str, ...]
    holdout: tuple[str, ...]
    fps: float | None
    output: Path
    resumes: bool


def tune_command(
    data: _Data,
    model: ModelOption = None,
    detections: DetectionsOption = None,
    output: _Output = Path("runs/tune"),
    preset: _Preset = "default",
    objective: _Objective = "hota",
    every: _Every = "1",
    holdout: _Holdout = None,
    only: _Only = "",
    trials: _Trials = 100,
    minutes: _Minutes = None,
    seed: _Seed = 0,
    classes: _Classes = "",
    frames: _Frames = None,
    fps: _Fps = None,
    benchmark: _Benchmark = "",
    resume: _Resume = False,
    overwrite: _Overwrite = False,
    provider: _Provider = "cpu",
    threads: _Threads = None,
) -> None:
    """Search a tracker's settings on your own truth.

    Detections are found once, or taken from files. Each trial then tracks with other settings and is scored; the best
    settings are scored on what was held out, too. Ctrl-C keeps what is found so far. The same seed finds the same
    settings.
    """
    objective = objective.lower()
    _check(objective, every, benchmark)
    asked = _Asked(
        begin=choose_tracker(preset),
        objective=objective,
        every=tuple(int(one) for one in every.split(",")),
        only=_names(only),
        trials=trials,
        minutes=minutes,
        seed=seed,
        classes=_names(classes),
        holdout=tuple(holdout or ()),
        fps=fps,
        output=output,
        resumes=resume,
    )
    choose_ranges(asked.begin.config, True, asked.only)  # refuses before any work
    truth = open_all(data, frames, benchmark)
    prepare_output_folder(output, [] if resume else [_TUNED, _TRIALS], overwrite)
    _tune(asked, *_open(asked, model, detections, provider, threads or available_cpus()), truth)


tune_command.__doc__ = f"{cleandoc(tune_command.__doc__ or '')}\n{_EXAMPLES}"


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _check(objective: str, every: str, benchmark: str) -> None:
    for name, value, choices in (("objective", objective, OBJECTIVES), ("benchmark", benchmark, ("", *BENCHMARKS))):
        if value not in choices:
            raise ConfigError(f"--{name} {value!r}: expected one of {', '.join(filter(None, choices))}")
    if not _EVERY.fullmatch(every) or len(set(every.split(","))) < len(every.split(",")):
        raise ConfigError(f"--every {every!r}: expected different whole numbers such as 1,2,4")
    try:
        import lookonce.tuning.searching  # noqa: F401
    except ModuleNotFoundError as exc:
        raise ConfigError(f"tune needs the extra 'tune' ({exc.name} is missing); pip install 'lookonce[tune]'") from exc


def _open(
    asked: _Asked, model: str | None, detections: Path | None, provider: str, threads: int
) -> tuple[DetectionSource, TrackerConfig, bool]:
    """Where detections come from, the settings to begin with, and whether there are descriptors."""
    begin, threshold = asked.begin.config, asked.begin.threshold()
    cache, camera_score = asked.output / "detections", detector_score(begin)
    every = asked.every if isinstance(begin, DefaultConfig) else ()
    if detections is None:
        least = lowest_score(begin)
        score = camera_score if least is None else least
        detector = Model(model or SHIPPED_MODEL, provider=provider, threads=threads, score_threshold=score)
        labels = labels_of(detector, asked.classes)
        source = DetectionSource(detector, None, None, labels, asked.fps, cache, every=every, camera_score=camera_score)
        return source, tracker_for(detector, begin, threshold).config, detector.metadata.descriptor is not None
    check_given(detections)
    source = DetectionSource(None, detections, None, (), asked.fps, cache, every=every, camera_score=camera_score)
    if model is None:
        return source, tracker_without_descriptors(detections, begin, None).config, False
    reader = BoxDescriber(model, provider=provider, threads=threads)
    return replace(source, describer=reader), tracker_for(reader, begin, threshold).config, True


def _in_words(source: DetectionSource) -> str:
    """Whose detections, and whose descriptors."""
    if source.model is not None:
        return one_line(source.model.path.name)
    assert source.files is not None
    described = "" if source.describer is None else f", descriptors of {one_line(source.describer.path.name)}"
    return f"{one_line(source.files.name)}{described}"


def _tune(
    asked: _Asked, source: DetectionSource, start: TrackerConfig, has_descriptors: bool, truth: Sequence[TrueSequence]
) -> None:
    from lookonce.tuning.searching import Search, best_settings  # needs Optuna

    start_s = time.perf_counter()
    ranges = choose_ranges(start, has_descriptors, asked.only)
    seconds = None if asked.minutes is None else 60 * asked.minutes
    search = Search(start, ranges, asked.objective, asked.trials, seconds, asked.seed)
    with StageScreen() as screen:
        scenes = find_scenes(truth, source, asked.classes, screen)
        data = hold_out(scenes, asked.holdout)
        searched, held_out = Scorer(data.searched, asked.every), Scorer(data.held_out, asked.every)
        screen.say(f"{data.in_words}; {len(ranges)} settings")
        about = _about(asked, source, start, ranges, data)
        file = TrialFile(asked.output / _TRIALS, about, ranges, resumes=asked.resumes)
        is_interrupted = _search(search, searched, file, screen)
        best = best_settings(start, file.trials)
        figures = TunedFigures.of(asked.objective, start, best, searched, held_out)
    lines = toml_lines(figures, file.trials, data, _in_words(source), asked.seed, has_descriptors)
    write_text(asked.output / _TUNED, tracker_settings_toml(best, about=lines))
    print_tuned(figures, file.trials, ranges, data)
    where = one_line(asked.output / _TUNED)
    print(f"{len(file.trials)} trials in {time.perf_counter() - start_s:.0f} s; written {where}")
    if is_interrupted:
        raise KeyboardInterrupt


def _search(search: Search, scorer: Scorer, file: TrialFile, screen: StageScreen) -> bool:
    """Runs the trials; whether somebody has stopped them with Ctrl-C after at least one."""

    def show() -> None:
        best = max(trial.score for trial in file.trials)
        note = f"{search.objective.upper()} {100 * best:.2f}, at first {100 * file.trials[0].score:.2f}"
        screen.stage("search", len(file.trials), search.trials, note)

    try:
        for _ in search.run(scorer, file):
            show()
    except KeyboardInterrupt:
        if not file.trials:
            raise
        screen.say("stopped; the best so far is kept, and --resume goes on")
        return True
    return False


def _about(
    asked: _Asked, source: DetectionSource, start: TrackerConfig, ranges: Sequence[SearchRange], data: TuningData
) -> dict[str, object]:
    """All that scores depend on: the first line of the trials."""
    network = source.model or source.describer
    return {
        "objective": asked.objective,
        "frame_rates": list(asked.every),
        "seed": asked.seed,
        "model": None if network is None else network.sha256,
        "settings": asdict(start),
        "ranges": {one.name: [one.low, one.high] for one in ranges},
        "data": {scene.name: scene.digest() for scene in data.searched},
        "held_out_data": {scene.name: scene.digest() for scene in data.held_out},
    }
