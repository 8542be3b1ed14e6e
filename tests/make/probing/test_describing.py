import logging
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from lookonce.datasets import open_sequences
from lookonce.errors import ConfigError, ModelError, VideoError
from lookonce.make.darknet.importer import import_darknet
from lookonce.make.probing import describe_sequences, open_reader, read_sequences
from lookonce.make.probing.reading import pair_by_overlap
from make.probing.labelled_squares import truth_lines, write_squares, write_truth
from squares import CELL, picture, write_darknet


@pytest.fixture
def squares(tmp_path):
    return open_sequences(write_squares(tmp_path / "squares"))


def test_each_truth_box_is_described_on_the_sequences_clock(squares, square_model):
    objects = describe_sequences(square_model, squares)
    assert objects.identities.tolist() == [1, 2, 3] * 12
    assert objects.frames.tolist() == np.repeat(np.arange(12), 3).tolist()
    np.testing.assert_allclose(objects.times_s, objects.frames / 10)
    assert set(objects.heights_px.tolist()) == set(objects.widths_px.tolist()) == {CELL}
    assert set(objects.grids.tolist()) == {0}
    red = objects.descriptors[objects.identities == 1]
    assert np.ptp(red, axis=0).max() < 0.01
    assert np.linalg.norm(objects.descriptors[0] - objects.descriptors[1]) > 0.5


def test_detections_are_the_same_objects_where_all_are_found(squares, square_model):
    truth = read_sequences(open_reader(square_model), squares)
    found = read_sequences(open_reader(square_model, "detections", score=0.3), squares)
    assert found.objects.identities.tolist() == truth.objects.identities.tolist()
    np.testing.assert_allclose(found.xyxy, truth.xyxy, atol=0.1)
    np.testing.assert_allclose(found.objects.descriptors, truth.objects.descriptors, atol=1e-5)
    assert found.tallies == truth.tallies


def test_truth_boxes_are_read_as_what_the_truth_says_they_are(squares, square_model):
    """By name; where the model has no such class, it decides for itself."""
    reader, asked = open_reader(square_model), []

    class Spy:
        path, metadata = reader.path, replace(reader.metadata, names=("car", "people"))

        def __call__(self, canvas, placed, xyxy, labels):
            asked.append(labels.tolist())
            return reader(canvas, placed, xyxy, np.full(len(xyxy), -1))

    for classes in (("pedestrian",), ("square",)):
        read_sequences(Spy(), [replace(squares[0], classes=classes)], every=6)
    assert asked == [[1, 1, 1], [1, 1, 1], [-1, -1, -1], [-1, -1, -1]]


def test_objects_that_are_not_detected_are_counted(tmp_path, square_model):
    lines = [*truth_lines(), *(f"{frame},9,40,16,8,8,1,-1,-1,-1" for frame in range(1, 13))]  # nothing is there
    write_squares(tmp_path)
    sequences = open_sequences(write_truth(tmp_path, lines))
    reading = read_sequences(open_reader(square_model, "detections"), sequences)
    (tally,) = reading.tallies
    assert (tally.truth_boxes, tally.found_boxes, tally.described_boxes) == (48, 36, 36)
    assert 9 not in reading.objects.identities
    # A black cell has features of zeros, which have no direction.
    (tally,) = read_sequences(open_reader(square_model), sequences).tallies
    assert (tally.truth_boxes, tally.found_boxes, tally.described_boxes) == (48, 48, 36)


def test_a_video_gives_what_its_pictures_give(tmp_path, squares, square_model, square_clip):
    truth = write_truth(tmp_path / "clip", truth_lines())
    objects = describe_sequences(square_model, open_sequences(truth, pictures=square_clip))
    expected = describe_sequences(square_model, squares)
    assert objects.frames.tolist() == expected.frames.tolist()
    np.testing.assert_allclose(objects.times_s, expected.times_s, atol=1e-3)
    np.testing.assert_allclose(objects.descriptors, expected.descriptors, atol=0.1)  # colours after compression


def test_sequences_are_numbered_in_the_order_given(tmp_path, square_model):
    sequences = [*open_sequences(write_squares(tmp_path / "b", 3)), *open_sequences(write_squares(tmp_path / "a", 2))]
    done = []
    objects = describe_sequences(square_model, sequences, on_frame=lambda *progress: done.append(progress))
    assert objects.sequences.tolist() == [0] * 9 + [1] * 6
    assert done == [("b", 1, 3), ("b", 2, 3), ("b", 3, 3), ("a", 1, 2), ("a", 2, 2)]


def test_every_nth_frame_is_taken(squares, square_model):
    assert np.unique(describe_sequences(square_model, squares, every=5).frames).tolist() == [0, 5, 10]


def test_no_sequences_give_no_rows(square_model):
    assert len(describe_sequences(square_model, [])) == 0


def test_an_unreadable_picture_is_left_out_and_counted(tmp_path, square_model, caplog):
    folder = write_squares(tmp_path / "squares")
    for name in ("000005.png", "000012.png"):  # also the last one: it is there, so the truth is not too long
        (folder / "img1" / name).write_bytes((folder / "img1" / name).read_bytes()[:60])
    with caplog.at_level(logging.WARNING):
        (tally,) = read_sequences(open_reader(square_model), open_sequences(folder)).tallies
    assert (tally.frames, tally.lost_frames, tally.truth_boxes) == (10, 2, 30)
    assert sum("000005.png" in message for message in caplog.messages) == 1


def test_truth_beyond_the_end_of_a_video_is_refused(tmp_path, square_model, square_clip):
    sequences = open_sequences(write_truth(tmp_path, truth_lines(15)), pictures=square_clip)
    with pytest.raises(VideoError, match=r"last frame is 11, but .* truth for frame 12 and 2 more .*right video") as e:
        describe_sequences(square_model, sequences)
    assert str(e.value).isprintable()


def test_a_picture_of_another_size_is_refused(tmp_path, square_model):
    folder = write_squares(tmp_path / "squares")
    Image.fromarray(picture(5)[:32]).save(folder / "img1" / "000006.png")
    sequences = open_sequences(folder)
    with pytest.raises(VideoError, match="frame 5 has 64 x 32 px, the first one 64 x 64") as caught:
        describe_sequences(square_model, sequences)
    assert str(caught.value).isprintable()


def test_a_folder_without_a_frame_rate_says_what_is_assumed(tmp_path, square_model, caplog):
    sequences = open_sequences(write_squares(tmp_path / "squares", 2, info=""))
    with caplog.at_level(logging.WARNING):
        objects = describe_sequences(square_model, sequences)
    (said,) = caplog.messages
    assert said.endswith("img1: states no frame rate; 25 frames per second are assumed (--fps)")
    assert objects.times_s[-1] == pytest.approx(1 / 25)
    caplog.clear()
    assert describe_sequences(square_model, sequences, fps=5).times_s[-1] == pytest.approx(1 / 5)
    assert caplog.messages == []


@pytest.mark.parametrize("boxes", ["truth", "detections"])
def test_a_model_without_descriptors_is_refused(boxes, tmp_path):
    cfg, weights, names = write_darknet(tmp_path)
    import_darknet(cfg, weights, tmp_path / "plain.onnx", names=names, descriptors=False)
    with pytest.raises(ModelError, match=r"plain.onnx: has no descriptors; train some with 'lookonce fit'"):
        open_reader(tmp_path / "plain.onnx", boxes)


def test_unknown_boxes_are_refused(square_model):
    with pytest.raises(ConfigError, match="boxes 'both': expected truth or detections"):
        open_reader(square_model, "both")


def _boxes(*lefts):
    return np.array([[left, 0, left + 10, 10] for left in lefts], np.float32).reshape(-1, 4)


@pytest.mark.parametrize(
    ("truth", "found", "expected"),
    [
        pytest.param([0, 20], [21, 1], [(0, 1), (1, 0)], id="each-its-own"),
        pytest.param([0, 2], [1.5], [(1, 0)], id="best-overlap-first"),
        pytest.param([0], [1, 0.5], [(0, 1)], id="nearer-detection"),
        pytest.param([0], [4], [], id="too-little-overlap"),
        pytest.param([0], [2.5], [(0, 0)], id="three-fifths"),
        pytest.param([], [1], [], id="no-truth"),
        pytest.param([1], [], [], id="no-detections"),
        pytest.param([], [], [], id="neither"),
        pytest.param([0, 0], [0, 0], [(0, 0), (1, 1)], id="equal-ones-in-order"),
    ],
)
def test_detections_are_given_to_the_truth_they_overlap_most(truth, found, expected):
    rows, partners = pair_by_overlap(_boxes(*truth), _boxes(*found))
    assert list(zip(rows.tolist(), partners.tolist(), strict=True)) == expected
