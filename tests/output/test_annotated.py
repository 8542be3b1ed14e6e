import av
import numpy as np
import pytest

from lookonce.errors import OutputError
from lookonce.output import AnnotatedVideoSink
from output.scenes import make_frame, make_tracks

BOX = [20.0, 30.0, 50.0, 50.0]


def _written(path):
    """Times and pictures of a video."""
    with av.open(str(path)) as container:
        return [(frame.time, frame.to_ndarray(format="rgb24").astype(int)) for frame in container.decode(video=0)]


def test_frames_keep_their_time_and_show_their_tracks(tmp_path):
    with AnnotatedVideoSink(tmp_path / "v.mp4", ["person"], 25.0) as sink:
        sink.write(make_frame(0, 0.0), make_tracks())
        sink.write(make_frame(3, 0.12), make_tracks([1], [BOX]))
    (first_s, plain), (second_s, drawn) = _written(tmp_path / "v.mp4")
    assert (round(first_s, 3), round(second_s, 3)) == (0.0, 0.12)
    assert np.abs(plain - 100).max() < 12  # encoding moves grey a little
    assert np.abs(drawn - 100).max() > 50


def test_frame_is_not_modified(tmp_path):
    frame = make_frame()
    with AnnotatedVideoSink(tmp_path / "v.mp4", ["person"], 25.0) as sink:
        sink.write(frame, make_tracks([1], [BOX]))
    assert (frame.picture == 100).all()


def test_moving_object_has_a_trail(tmp_path):
    with AnnotatedVideoSink(tmp_path / "v.mp4", ["person"], 25.0) as sink:
        for index in range(3):
            sink.write(
                make_frame(index, index / 25, 120, 160), make_tracks([1], [[20 + 40 * index, 40, 40 + 40 * index, 80]])
            )
    _, last = _written(tmp_path / "v.mp4")[-1]
    assert np.abs(last[79:82, 40:95] - 100).max() > 30


def test_later_frames_of_another_size_are_scaled_to_the_first(tmp_path):
    with AnnotatedVideoSink(tmp_path / "v.mp4", ["person"], 25.0) as sink:
        for index, (height, width) in enumerate([(60, 80), (120, 160), (61, 81)]):
            sink.write(make_frame(index, index / 25, height, width), make_tracks([1], [BOX]))
    assert [picture.shape for _, picture in _written(tmp_path / "v.mp4")] == [(60, 80, 3)] * 3


def test_closing_twice_is_fine(tmp_path):
    sink = AnnotatedVideoSink(tmp_path / "v.mp4", ["person"], 25.0)
    sink.write(make_frame(), make_tracks())
    sink.close()
    sink.close()
    assert len(_written(tmp_path / "v.mp4")) == 1


def test_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(OutputError, match=r"nowhere/v\.mp4"):
        AnnotatedVideoSink(tmp_path / "nowhere/v.mp4", [], 25.0)
