"""Speed, memory, import time and size of lookonce on a video: the model alone against the whole pipeline.

    python benchmarks/speed.py VIDEO -m MODEL.onnx --frames 300 --rounds 3
    python benchmarks/speed.py VIDEO -m MODEL.onnx --scale 960x540 --install

The forms of a round run in turn, A B C D A B C D, each over the same frames:

    model, all threads      the model alone on letterboxed frames in memory, one at a time on all processors
    model, side by side     the same, as many at once as the pipeline infers
    pipeline                decoding, letterboxing, inference, association, tracks.txt and tracks.jsonl
    pipeline and video      the same with the annotated video

Ratios are medians of the ratios within the rounds. CPU ms is the time of all processors together for one frame.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clips import parse_size, rescale
from lookonce import Model, open_video
from lookonce.letterbox import Fit, Letterboxer
from lookonce.output import AnnotatedVideoSink, JsonLinesSink, MotSink, Sink
from lookonce.pipeline import StageTimes, share_processors, track_video, tracker_for
from machine import describe_machine

WARM_UP_FRAMES = 10
GOAL = 0.9  # of the model alone on all threads
REPOSITORY = Path(__file__).parents[1]
HEAVY = ("torch", "cv2", "onnx", "matplotlib", "pandas")  # not wanted in an installation that only tracks

Prepared = list[tuple[NDArray[np.uint8], Fit]]


@dataclass(frozen=True, slots=True)
class Pass:
    """One form's way through all frames: frames a second, CPU milliseconds a frame."""

    fps: float
    cpu_ms: float


@dataclass(frozen=True, slots=True)
class Bench:
    """What all forms share.

    Attributes:
        video: the file.
        frames: how many frames of it.
        alone: the model on all threads.
        shared: the model with the threads that the pipeline gives it.
        workers: how many frames the pipeline infers at once.
        prepared: letterboxed frames.
    """

    video: Path
    frames: int
    alone: Model
    shared: Model
    workers: int
    prepared: Prepared

    def model_alone(self) -> None:
        """One frame at a time on all threads."""
        for canvas, placed in self.prepared:
            self.alone.run(canvas[np.newaxis], [placed])

    def model_side_by_side(self) -> None:
        """As many frames at once as the pipeline infers."""
        with ThreadPoolExecutor(self.workers) as pool:
            for _ in pool.map(lambda item: self.shared.run(item[0][np.newaxis], [item[1]]), self.prepared):
                pass

    def pipeline(self, times: StageTimes, annotate: bool) -> None:
        """Everything that `lookonce track` does but its progress display."""
        with tempfile.TemporaryDirectory() as folder, open_video(self.video, max_frames=self.frames) as video:
            names = self.shared.names
            sinks: list[Sink] = [MotSink(Path(folder) / "t.txt"), JsonLinesSink(Path(folder) / "t.jsonl", {}, names)]
            if annotate:
                sinks.append(AnnotatedVideoSink(Path(folder) / "t.mp4", names, video.rate or 25.0))
            for _ in track_video(
                video, self.shared, tracker_for(self.shared), workers=self.workers, sinks=sinks, times=times
            ):
                pass
            for sink in sinks:
                sink.close()


def timed(form: Callable[[], None], frames: int) -> Pass:
    """One pass of a form."""
    wall, cpu = time.perf_counter(), time.process_time()
    form()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return Pass(frames / wall, cpu / frames * 1000)


def prepare(video: Path, model: Path, frames: int) -> Bench:
    """Opens everything and runs it warm."""
    threads, workers = share_processors(is_live=False)
    alone, shared = Model(model), Model(model, threads=threads)
    letterbox = Letterboxer(alone.size)
    with open_video(video, max_frames=frames) as source:
        prepared = [letterbox(frame.picture, frame.rotation) for frame in source]
    for canvas, placed in prepared[:WARM_UP_FRAMES]:
        alone.run(canvas[np.newaxis], [placed])
        shared.run(canvas[np.newaxis], [placed])
    return Bench(video, len(prepared), alone, shared, workers, prepared)


def run_rounds(bench: Bench, rounds: int) -> tuple[dict[str, list[Pass]], dict[str, StageTimes]]:
    """Every form's pass in every round, and the stages of the two pipelines over all rounds."""
    stages = {"pipeline": StageTimes(), "pipeline and video": StageTimes()}
    forms: dict[str, Callable[[], None]] = {
        "model, all threads": bench.model_alone,
        "model, side by side": bench.model_side_by_side,
        "pipeline": lambda: bench.pipeline(stages["pipeline"], annotate=False),
        "pipeline and video": lambda: bench.pipeline(stages["pipeline and video"], annotate=True),
    }
    passes: dict[str, list[Pass]] = {name: [] for name in forms}
    for _ in range(rounds):
        for name, form in forms.items():
            passes[name].append(timed(form, bench.frames))
    return passes, stages


def print_speed(bench: Bench, passes: dict[str, list[Pass]]) -> None:
    """Frames a second of each form and the pipelines' share of the model alone."""
    print(
        f"\nmodel alone: {bench.alone.threads} threads; side by side and pipeline: "
        f"{bench.workers} frames at once, {bench.shared.threads} threads each"
    )
    print(f"{'form':<22} {'fps':>7} {'CPU ms':>7}   rounds")
    for name, each in passes.items():
        fps = [p.fps for p in each]
        rounds = " ".join(f"{value:.1f}" for value in fps)
        print(f"{name:<22} {np.median(fps):7.1f} {np.median([p.cpu_ms for p in each]):7.1f}   {rounds}")
    fps = {name: np.array([p.fps for p in each]) for name, each in passes.items()}
    alone, side_by_side = fps["model, all threads"], fps["model, side by side"]
    faster = alone if np.median(alone) >= np.median(side_by_side) else side_by_side
    cpu = {name: np.array([p.cpu_ms for p in each]) for name, each in passes.items()}
    for name in ("pipeline", "pipeline and video"):
        more = float(np.median(cpu[name] / cpu["model, side by side"]))
        of_alone, of_faster = (float(np.median(fps[name] / form)) for form in (alone, faster))
        verdict = "" if name != "pipeline" else f" (goal {GOAL}: {'met' if of_alone >= GOAL else 'missed'})"
        print(f"{name}: {of_alone:.3f} of the model on all threads{verdict}, {of_faster:.3f} of its faster form")
        print(f"  and {more:.3f} times the CPU time of the model side by side")


def print_stages(stages: dict[str, StageTimes]) -> None:
    """Milliseconds a frame of each stage."""
    names = list(next(iter(stages.values())).seconds)
    print("\nms a frame in each stage, by the clock; decode and letterbox run in one thread beside the others, detect")
    print(f"is one inference while {next(iter(stages.values())).workers} run at once")
    print(f"{'form':<22}" + "".join(f"{name:>11}" for name in names))
    for form, times in stages.items():
        each = [times.seconds[name] / times.frames * 1000 for name in names]
        print(f"{form:<22}" + "".join(f"{value:11.3f}" for value in each), flush=True)


def print_stages_alone(bench: Bench) -> None:
    """CPU milliseconds a frame of the reading stages on their own."""
    with open_video(bench.video, max_frames=bench.frames) as video:
        start = time.process_time()
        frames = list(islice(video, bench.frames))
        decode = (time.process_time() - start) / len(frames) * 1000
    letterbox = Letterboxer(bench.alone.size)
    start = time.process_time()
    for frame in frames:
        letterbox(frame.picture, frame.rotation)
    letterboxing = (time.process_time() - start) / len(frames) * 1000
    print(f"CPU ms a frame, each on its own: decode {decode:.3f}, letterbox {letterboxing:.3f}", flush=True)


def peak_memory_mb(command: Sequence[str]) -> float:
    """The most memory that a command held.

    A small interpreter starts it: a child forked by this large process would be counted with this one's memory.
    """
    launcher = (
        "import resource, subprocess, sys\n"
        "subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)\n"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    done = subprocess.run([sys.executable, "-c", launcher, *command], capture_output=True, text=True, check=True)
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
    return int(done.stdout) * unit / 1e6


def lookonce_command(*arguments: object) -> list[str]:
    """The command line of this very installation."""
    return [sys.executable, "-c", "from lookonce.cli.app import main; main()", *map(str, arguments)]


def print_memory(bench: Bench) -> None:
    """Peak memory of `lookonce track`."""
    print("\npeak memory of `lookonce track`, MB")
    with tempfile.TemporaryDirectory() as folder:
        for option in ("--no-video", "--video"):
            command = lookonce_command(
                "track", bench.video, "-m", bench.alone.path, "--max-frames", bench.frames,
                "-o", Path(folder) / option, option,
            )  # fmt: skip
            print(f"  {option:<12} {peak_memory_mb(command):7.0f}")
    bare = [sys.executable, "-c", "import av, numpy, onnxruntime"]
    print(f"  {'of which':<12} {peak_memory_mb(bare):7.0f} for importing av, numpy and onnxruntime", flush=True)


def wall_ms(command: Sequence[str], runs: int = 5) -> float:
    """Median wall milliseconds of a fresh process."""
    times = []
    for _ in range(runs + 1):
        start = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - start)
    return statistics.median(times[1:]) * 1000  # the first filled the disk cache


def print_start_times() -> None:
    """How long fresh interpreters take."""
    bare = wall_ms([sys.executable, "-c", "pass"])
    print(f"\nms of a fresh process, median of 5; an empty interpreter takes {bare:.0f}, left out of the others")
    commands = {
        "import lookonce": [sys.executable, "-c", "import lookonce"],
        "lookonce.Tracker": [sys.executable, "-c", "import lookonce; lookonce.Tracker"],
        "lookonce.track": [sys.executable, "-c", "import lookonce; lookonce.track"],
        "lookonce --help": lookonce_command("--help"),
    }
    for name, command in commands.items():
        print(f"  {name:<18} {wall_ms(command) - bare:7.0f}", flush=True)


def disk_mb(folder: Path) -> float:
    """All files below a folder."""
    return sum(p.lstat().st_size for p in folder.rglob("*") if not p.is_dir()) / 1e6


def print_install() -> None:
    """Size and packages of a fresh installation from wheels, without extras."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "venv"
        venv.create(root, with_pip=True, symlinks=os.name != "nt")
        python = root / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        empty = disk_mb(root)
        pip = [str(python), "-m", "pip", "--disable-pip-version-check"]
        subprocess.run([*pip, "install", "-qq", "--only-binary", ":all:", str(REPOSITORY)], check=True)
        listed = subprocess.run([*pip, "list", "--format", "freeze"], capture_output=True, text=True, check=True)
        packages = [line for line in listed.stdout.splitlines() if not line.startswith(("pip==", "setuptools=="))]
        finder = f"from importlib.util import find_spec as f; print(*(n for n in {HEAVY!r} if f(n)))"
        heavy = subprocess.run([str(python), "-c", finder], capture_output=True, text=True, check=True).stdout.split()
        print(f"\ninstallation from wheels only: {disk_mb(root) - empty:.0f} MB, {len(packages)} packages")
        print("  " + ", ".join(packages))
        print(f"  of {', '.join(HEAVY)}: {', '.join(heavy) or 'none'}")
        folders = (p for p in next(root.rglob("site-packages")).iterdir() if p.is_dir() and p.name != "pip")
        largest = sorted(((disk_mb(p), p.name) for p in folders), reverse=True)[:8]
        print("  largest, MB: " + ", ".join(f"{name} {size:.1f}" for size, name in largest), flush=True)


def parse_arguments() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("video", type=Path)
    parser.add_argument("-m", "--model", type=Path, required=True)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scale", type=parse_size, metavar="WIDTHxHEIGHT", help="make the video this large first")
    parser.add_argument("--install", action="store_true", help="also measure a fresh installation; needs an index")
    return parser.parse_args()


def main() -> None:
    """Print everything."""
    arguments = parse_arguments()
    print(describe_machine())
    with tempfile.TemporaryDirectory() as folder:
        video = arguments.video
        if arguments.scale:
            video = rescale(video, Path(folder) / "scaled.mp4", arguments.scale, arguments.frames)
        bench = prepare(video, arguments.model, arguments.frames)
        with open_video(video) as source:
            height, width = source.size or (0, 0)
        print(
            f"{arguments.video.name} at {width}x{height}, {bench.frames} frames, {arguments.rounds} rounds; "
            f"{arguments.model.name}, input {bench.alone.size[0]}x{bench.alone.size[1]}"
        )
        passes, stages = run_rounds(bench, arguments.rounds)
        print_speed(bench, passes)
        print_stages(stages)
        print_stages_alone(bench)
        print_memory(bench)
    print_start_times()
    if arguments.install:
        print_install()


if __name__ == "__main__":
    main()
