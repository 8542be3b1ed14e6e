"""Descriptors of a model at its own detections of true objects."""

from __future__ import annotations

from pathlib import Path

from darknet_files import TINY
from datasets.making import refusal
from lookonce.datasets import open_sequences
from lookonce.errors import ModelError
from lookonce.evaluation import TrackingTruth
from lookonce.model import Model
from lookonce.report.described import DescribedSequence, describe
from lookonce.report.spans import Clock
from make.probing.labelled_squares import write_squares


def described(model: Path, folder: Path, **clock: float):
    (sequence,) = open_sequences(folder)
    one = DescribedSequence("squares", TrackingTruth.of_sequence(sequence), folder / "img1", Clock({}, **clock))
    steps: list[tuple[str, int, int]] = []
    return describe(Model(model, threads=1), [one], lambda *step: steps.append(step)), steps


def test_squares_of_one_colour_are_nearer_than_those_of_two(square_model: Path, tmp_path: Path):
    found, steps = described(square_model, write_squares(tmp_path / "squares"), rate=10.0)
    assert (found.frames, found.boxes, found.identities) == (12, 36, 3)
    assert steps[-1] == ("squares", 12, 12)
    pairs = sum(12 - gap for gap in range(5, 12))  # of frames half a second apart or more
    assert (sum(found.genuine), sum(found.impostor)) == (3 * pairs, 6 * pairs)
    assert found.genuine[0] == 3 * pairs  # each colour is always the same
    assert found.roc_auc == 1
    assert found.equal_error_rate == 0
    assert found.threshold is None


def test_boxes_that_the_model_does_not_find_are_not_described(square_model: Path, tmp_path: Path):
    folder = write_squares(tmp_path / "squares")
    lines = (folder / "gt" / "gt.txt").read_text().splitlines()
    lines += [f"{frame},9,40,0,6,6,1,-1,-1,-1" for frame in range(1, 13)]  # where nothing is
    (folder / "gt" / "gt.txt").write_text("\n".join(lines) + "\n")
    found, _ = described(square_model, folder, rate=10.0)
    assert (found.boxes, found.identities) == (36, 3)


def test_without_time_frames_are_taken_at_the_usual_rate(square_model: Path, tmp_path: Path):
    found, _ = described(square_model, write_squares(tmp_path / "squares"))
    assert (sum(found.genuine), sum(found.impostor)) == (0, 0)  # 12 frames at 25 per second are too short
    assert found.boxes == 36


def test_a_model_without_descriptors_is_refused(tiny_model, tmp_path: Path):
    model = tiny_model(next(iter(TINY)), descriptors=False).path
    message = refusal(ModelError, lambda: described(model, write_squares(tmp_path / "squares")))
    assert "no descriptors" in message
