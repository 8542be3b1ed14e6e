"""Sequences and videos as sources: every task can be called at any time, in any thread, with the same result."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from datasets.making import refusal
from lookonce.datasets import LabelledSequence, open_sequences
from lookonce.errors import VideoError
from lookonce.make.training.batches import comparable
from lookonce.make.training.linking import link_detections
from lookonce.make.training.sources import Canvas, SequenceSource, TrackedBoxes, coexist
from make.training.scenes import make_detections, make_readings, write_labelled, write_resting_clip
from squares import CELL, SIZE

CANVAS = (64, 96)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return open_sequences(write_labelled(tmp_path_factory.mktemp("sequences") / "walk"))[0]


def make_source(tracked: TrackedBoxes, *, held_out=(False, False, True), frames: int = 100, seed: int = 1, size=CANVAS):
    return SequenceSource(tracked, size, frames=frames, held_out=np.array(held_out), seed=[seed])


def as_bytes(canvas: Canvas) -> tuple[bytes, ...]:
    return tuple(a.tobytes() for a in (canvas.pixels, canvas.boxes, canvas.identities, canvas.frames))


def test_a_sequence_gives_two_tasks_for_each_frame(sequence):
    source = make_source(TrackedBoxes.of_sequence(sequence))
    canvases = [task() for task in source.tasks()]
    assert len(canvases) == source.task_count == 24
    for canvas in canvases:
        assert canvas.pixels.shape == (*CANVAS, 3)
        assert len(canvas.boxes) == len(canvas.identities) == len(canvas.frames) == len(canvas.heights_px)
        assert len(set(canvas.frames.tolist())) <= 1
    assert {int(canvas.frames[0]) for canvas in canvases[::2]} == set(range(12))


def test_tasks_do_not_depend_on_order_or_thread(sequence):
    tasks = list(make_source(TrackedBoxes.of_sequence(sequence)).tasks())
    in_order = [as_bytes(task()) for task in tasks]
    again = list(make_source(TrackedBoxes.of_sequence(sequence)).tasks())
    with ThreadPoolExecutor(4) as pool:
        side_by_side = list(pool.map(lambda task: as_bytes(task()), again[::-1]))[::-1]
    assert side_by_side == in_order
    other = [as_bytes(task()) for task in make_source(TrackedBoxes.of_sequence(sequence), seed=2).tasks()]
    assert other != in_order


def test_frames_as_they_are_show_the_truth_and_held_out_boxes_exactly(sequence):
    source = make_source(TrackedBoxes.of_sequence(sequence), size=(SIZE, SIZE))
    for index, task in enumerate(list(source.tasks())[::2]):
        canvas = task()
        truth = sequence.frames[index].objects.xyxy
        assert canvas.identities.tolist() == [0, 1, 2]
        assert canvas.boxes[2].tolist() == truth[2].tolist()
        assert (canvas.boxes[:2] != truth[:2]).any()
        assert np.abs(canvas.boxes[:2] - truth[:2]).max() < CELL / 2
        left, top, right, bottom = truth[2].astype(int)
        assert canvas.pixels[top:bottom, left:right, 2].min() > 200  # the blue square


def test_held_out_identities_are_shown_as_they_are_only(sequence):
    source = make_source(TrackedBoxes.of_sequence(sequence), held_out=(False, True, True))
    transformed = [task() for task in list(source.tasks())[1::2]]
    assert {identity for canvas in transformed for identity in canvas.identities.tolist()} == {0}


def test_frames_are_spread_evenly(sequence):
    source = make_source(TrackedBoxes.of_sequence(sequence), frames=4)
    assert source.task_count == 8
    frames = [int(task().frames[0]) for task in list(source.tasks())[::2]]
    assert frames[0] == 0
    assert frames[-1] == 11
    assert set(np.diff(frames)) <= {3, 4}


def test_boxes_that_show_mostly_something_else_are_left_out(sequence):
    """Rows of truth that are hidden behind others would teach the looks of whatever is in front."""
    hidden = replace(
        sequence.frames[0], objects=replace(sequence.frames[0].objects, visibility=np.array([1, 0.2, 0.6], np.float32))
    )
    tracked = TrackedBoxes.of_sequence(replace(sequence, frames=(hidden, *sequence.frames[1:])))
    assert (tracked.frames == 0).sum() == 2
    assert tracked.identities[tracked.frames == 0].tolist() == [0, 2]
    assert len(tracked.xyxy) == 35


def test_identities_are_numbered_without_gaps(sequence):
    frames = tuple(
        replace(frame, objects=replace(frame.objects, identities=np.array([7, 100, 3]))) for frame in sequence.frames
    )
    tracked = TrackedBoxes.of_sequence(replace(sequence, frames=frames))
    assert tracked.identities[:3].tolist() == [1, 2, 0]
    assert tracked.is_complete


def test_frames_that_the_pictures_lack_are_one_line(sequence):
    tracked = TrackedBoxes.of_sequence(sequence)
    beyond = replace(tracked, frames=tracked.frames + 5)
    message = refusal(VideoError, lambda: list(make_source(beyond).tasks()))
    assert "no frame 12" in message
    assert "(5 such frames)" in message
    assert "walk" in message


def test_sequences_without_boxes_have_no_tasks(sequence):
    nothing = LabelledSequence("none", "kitti", sequence.pictures, None, (), ("a",), np.zeros((0, 4), np.float32))
    tracked = TrackedBoxes.of_sequence(nothing)
    source = make_source(tracked, held_out=np.zeros(0, bool))
    assert source.task_count == 0
    assert list(source.tasks()) == []
    assert source.lifetimes.shape == (0, 2)


def link_resting(tmp_path, starts=(0, 0, 8)) -> TrackedBoxes:
    """Three tracks: two at once from frame 0, one later."""
    frames = []
    for index in range(16):
        lefts = [100 * number for number, start in enumerate(starts) if start <= index < start + 8]
        boxes = [[left, 0, left + 30, 30] for left in lefts]
        frames.append((index, index / 10, make_detections(boxes)))
    return TrackedBoxes.of_links("walk", tmp_path / "clip.mp4", link_detections(frames))


def test_linked_tracks_live_as_long_as_they_are_seen(tmp_path):
    tracked = link_resting(tmp_path)
    assert not tracked.is_complete
    source = make_source(tracked)
    assert source.lifetimes.tolist() == [[0, 7], [0, 7], [8, 15]]


def test_true_tracks_live_for_ever(sequence):
    lifetimes = make_source(TrackedBoxes.of_sequence(sequence)).lifetimes
    assert coexist(lifetimes[:, None], lifetimes).all()


def test_lives_coexist_where_they_share_a_frame():
    lives = np.array([[0, 7], [7, 9], [8, 15], [30, 40]])
    expected = [[1, 1, 0, 0], [1, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 1]]
    assert coexist(lives[:, None], lives).astype(int).tolist() == expected


def test_pairs_of_tracks_that_may_be_one_object_are_not_comparable():
    readings = make_readings(4, rows=2, sources=2)
    readings = replace(readings, lifetime=np.array([[0, 9], [0, 9], [20, 29], [5, 9]]))
    rows = np.array([0, 2, 4, 6])  # one of each identity; sources 0, 1, 0, 1
    expected = [[1, 1, 0, 1], [1, 1, 1, 1], [0, 1, 1, 1], [1, 1, 1, 1]]
    assert comparable(readings, rows).astype(int).tolist() == expected


def test_a_linked_video_is_read_like_a_sequence(tmp_path, square_model):
    from lookonce import open_video
    from lookonce.model import Model

    clip = write_resting_clip(tmp_path / "rest.mp4")
    model = Model(square_model, threads=1)
    with open_video(clip) as video:
        links = link_detections([(frame.index, frame.time_s, model.detect(frame)) for frame in video])
    tracked = TrackedBoxes.of_links("rest", clip, links)
    assert links.tracks == 12
    source = make_source(tracked, held_out=np.zeros(12, bool), size=(SIZE, SIZE))
    assert source.task_count == 48
    assert all(len(task().boxes) == 3 for task in list(source.tasks())[::2])
