"""Lets trackers loose on the scenes and scores what they leave behind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lookonce.cli.compare_rows import CompareRow, Speed
from lookonce.cli.compare_scenes import Scene
from lookonce.cli.evaluated_results import ResultFile, SequenceResult
from lookonce.cli.evaluated_runs import ClassChoice, EvaluatedRun, evaluate_run
from lookonce.cli.evaluated_truth import TrueSequence, thin
from lookonce.cli.stages import StageScreen
from lookonce.compare.associated import Associated
from lookonce.compare.contenders.registry import CROPS, PLAIN_SCORE, Contender
from lookonce.compare.jobs import Answer, select
from lookonce.compare.oracle import oracle_ids
from lookonce.compare.results import write_results
from lookonce.compare.running import TrackerProcess

__all__ = ["ORACLE", "Comparison", "absence"]

ORACLE = "oracle"
_MATCH_IOU = {"trackeval": 0.5, "detrac": 0.7}  # what a new match needs
_ORACLE_TITLE = "oracle (true identities)"


@dataclass(slots=True)
class Comparison:
    """One comparison: the scenes and how they are evaluated.

    Attributes:
        scenes: sequences with detections.
        protocol: of the figures.
        labels: of the detector's classes; empty = all.
        min_score: of the detections that everybody gets.
        limit_s: for one sequence.
        screen: where progress goes.
        thinned: by frame rate the truth that remains.
    """

    scenes: Sequence[Scene]
    protocol: str
    labels: tuple[int, ...]
    min_score: float
    limit_s: float
    screen: StageScreen
    thinned: dict[int, list[TrueSequence]] = field(default_factory=dict)

    def truth(self, every: int) -> list[TrueSequence]:
        """The truth of every so many-th frame."""
        if every not in self.thinned:
            self.thinned[every] = [thin(scene.true, every) for scene in self.scenes]
        return self.thinned[every]

    def run(
        self, process: TrackerProcess, every: int, folder: Path, threshold: float | None = None, note: str = ""
    ) -> CompareRow:
        """A tracker on all scenes at one frame rate.

        Args:
            process: of the tracker.
            every: take every so many-th frame.
            folder: where its MOT texts go.
            threshold: of the detector; None = all detections, or for a tracker that has none, from ``PLAIN_SCORE``.
            note: why it is not to be run.
        """
        contender = process.contender
        min_score = self.min_score if threshold is None else threshold
        if threshold is None and not contender.has_own_threshold:
            min_score = max(min_score, PLAIN_SCORE)
        answers: list[Answer] = []
        where = f"threshold {threshold:.1f}" if threshold is not None else f"every {every}"
        for scene in self.scenes if not note else ():
            answer, associated = process.run(_detections(contender, scene), every, min_score, self.labels)
            if associated is None:
                note = f"{scene.true.name}: {answer.error}"
                break
            answers.append(answer)
            self._write(scene, every, min_score, associated, folder)
            self.screen.stage(f"{contender.title}, {where}", len(answers), len(self.scenes), "sequences")
        if note:
            return CompareRow(contender.name, contender.title, every, min_score, note, threshold=threshold)
        run = self._evaluate(contender.title, every, folder)
        speed = self._speed(contender, answers)
        return CompareRow(contender.name, contender.title, every, min_score, "", run, speed, threshold)

    def oracle(self, every: int, folder: Path, threshold: float | None = None) -> CompareRow:
        """The ceiling: the true identities on the same detections."""
        min_score = self.min_score if threshold is None else threshold
        for scene, true in zip(self.scenes, self.truth(every), strict=True):
            chosen = select(scene.stored.sequence, every, min_score, self.labels)
            write_results(_result(folder, scene), chosen, oracle_ids(chosen, true.truth, _MATCH_IOU[self.protocol]))
        run = self._evaluate(_ORACLE_TITLE, every, folder)
        return CompareRow(ORACLE, _ORACLE_TITLE, every, min_score, "", run, None, threshold)

    def detector(self, threshold: float, folder: Path) -> EvaluatedRun:
        """The detections themselves, each an identity of its own, so that matches are made frame by frame."""
        for scene in self.scenes:
            chosen = select(scene.stored.sequence, 1, threshold, self.labels)
            write_results(_result(folder, scene), chosen, np.arange(len(chosen)))
        return self._evaluate("detector", 1, folder)

    def _write(self, scene: Scene, every: int, min_score: float, answer: Associated, folder: Path) -> None:
        write_results(_result(folder, scene), select(scene.stored.sequence, every, min_score, self.labels), answer)

    def _evaluate(self, title: str, every: int, folder: Path) -> EvaluatedRun:
        """From the files, so that `lookonce eval` says the same of them."""

        def read(sequence: TrueSequence) -> SequenceResult:
            return ResultFile((folder / f"{sequence.name}.txt",)).read()

        return evaluate_run(title, self.truth(every), read, {}, self.protocol, ClassChoice())

    def _speed(self, contender: Contender, answers: Sequence[Answer]) -> Speed:
        """Means over all frames; what was found in other frames than these took as long."""
        scenes = [scene.crops if contender.name == CROPS and scene.crops else scene.stored for scene in self.scenes]
        found = max(1, sum(len(one.sequence.frames) for one in scenes))
        tracked = max(1, sum(answer.frames for answer in answers))
        detect = sum(one.detect_s for one in scenes)
        return Speed(
            detect_s=detect / found,
            describe_s=sum(one.describe_s for one in scenes) / found if contender.uses_descriptors else 0.0,
            associate_s=sum(answer.seconds for answer in answers) / tracked,
            associate_cpu_s=sum(answer.cpu_s for answer in answers) / tracked,
            is_one_look=contender.uses_descriptors and contender.name != CROPS and _are_one_look(self.scenes),
            peak_mb=max((answer.peak_mb for answer in answers), default=0.0),
        )


def _are_described(scenes: Sequence[Scene]) -> bool:
    """Whether detections have descriptors."""
    return any(scene.stored.sequence.descriptors is not None for scene in scenes)


def _are_one_look(scenes: Sequence[Scene]) -> bool:
    """Whether they came with them: nobody had to read them at the boxes of others."""
    return _are_described(scenes) and not any(scene.stored.describe_s for scene in scenes)


def _result(folder: Path, scene: Scene) -> Path:
    return folder / f"{scene.true.name}.txt"


def _detections(contender: Contender, scene: Scene) -> Path:
    return scene.crops_path if contender.name == CROPS and scene.crops_path is not None else scene.path


def absence(contender: Contender, scenes: Sequence[Scene]) -> str:
    """Why a tracker cannot take part; "" = it can."""
    if not contender.is_installed:
        return f"not installed: pip install {contender.package}"
    if contender.name == CROPS:
        return "" if all(scene.crops is not None for scene in scenes) else "left out: no crop network (--crops)"
    is_needy = contender.needs_descriptors and not _are_described(scenes)
    return "left out: the detections have no descriptors" if is_needy else ""
