"""Tracking again on every n-th frame only, for `lookonce eval --sweep`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lookonce.cli.evaluated_results import SequenceResult
from lookonce.cli.evaluated_truth import TrueSequence
from lookonce.cli.stages import StageScreen
from lookonce.datasets import usual_name
from lookonce.errors import ConfigError
from lookonce.evaluation import ResultCollector
from lookonce.model import Model
from lookonce.pipeline import share_processors, track_video, tracker_for
from lookonce.tracking import Tracker
from lookonce.tracking.settings import ChosenTracker
from lookonce.video import open_video

__all__ = ["SweepSettings", "Sweeper", "parse_sweep"]

_SWEEP = re.compile(r"every=([1-9][0-9]{0,5}(?:,[1-9][0-9]{0,5})*)")


@dataclass(frozen=True, slots=True)
class SweepSettings:
    """What is tracked, and how.

    Attributes:
        every: take every so many-th frame: one run each.
        model: a model file or the name of one that ships.
        tracker: the settings, and whether they say a match threshold.
        score: keep detections above this score.
        provider: where the model runs.
        threads: for one inference; None = shared out.
    """

    every: tuple[int, ...]
    model: str
    tracker: ChosenTracker
    score: float
    provider: str
    threads: int | None


def parse_sweep(text: str) -> tuple[int, ...]:
    """The numbers of ``every=1,2,4``.

    Raises:
        ConfigError: it says something else, or a number twice.
    """
    found = _SWEEP.fullmatch(text.replace(" ", ""))
    numbers = tuple(int(part) for part in found[1].split(",")) if found else ()
    if not numbers or len(set(numbers)) < len(numbers):
        raise ConfigError(f"--sweep {text!r}: expected every= and different whole numbers, such as every=1,2,4,8")
    return numbers


class Sweeper:
    """Tracks sequences with one model; a new tracker for each pass.

    Args:
        settings: what to do.
        classes: track only these classes of the model, by their usual names; none = all.
        screen: where progress goes.

    Attributes:
        config: the tracker's settings in force.

    Raises:
        LookonceError: the model cannot be opened, has no descriptors, or none of the classes.
    """

    def __init__(self, settings: SweepSettings, classes: Sequence[str], screen: StageScreen) -> None:
        self._settings = settings
        threads, self._workers = share_processors(False, settings.threads, settings.provider)
        self.model = Model(settings.model, provider=settings.provider, threads=threads, score_threshold=settings.score)
        self.config = self._tracker().config  # refuses before the first frame
        wanted = {usual_name(name) for name in classes}
        self._labels = np.array(
            [label for label, name in enumerate(self.model.names) if usual_name(name) in wanted], np.int64
        )
        if wanted and not len(self._labels):
            known = ", ".join(self.model.names[:12])
            raise ConfigError(f"{self.model.path}: finds none of the classes {', '.join(classes)}; it has {known}")
        self._screen = screen

    def _tracker(self) -> Tracker:
        chosen = self._settings.tracker
        return tracker_for(self.model, chosen.config, chosen.threshold())

    def track(self, sequence: TrueSequence, every: int) -> SequenceResult:
        """The tracks on every so many-th frame of a sequence, from the first."""
        tracker, collected = self._tracker(), ResultCollector()
        stage = f"every {every}: {sequence.name}"
        with open_video(sequence.pictures, every=every, fps=sequence.fps) as video:
            tracked = track_video(video, self.model, tracker, labels=self._labels, workers=self._workers)
            for done, frame in enumerate(tracked, 1):
                collected.add(frame.index, frame.tracks)
                self._screen.stage(stage, done, video.frame_count, "frames")
        return SequenceResult(collected.result(), self.model.names)
