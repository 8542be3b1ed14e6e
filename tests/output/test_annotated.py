import av
import numpy as np
import pytest

from lookonce.errors import OutputError
from lookonce.output import AnnotatedVideoSink
from output.scenes import make_frame, make_tracks

BOX = [20.0, 30.0, 50.0, 50.0]


class RecordingWriter:
    """Keeps what it is given."""

    def __init__(self, path, rate_hint):
        self.path, self.rate_hint = path, rate_hint
        self.pictures, self.times_s = [], []
        self.close_calls = 0

    def write(self, rgb, time_s):
        self.pictures.append(rgb)
        self.times_s.append(time_s)

    def close(self):
        self.close_calls += 1


class FullDiskWriter(RecordingWriter):
    """Takes nothing, and cannot be completed."""

    def write(self, rgb, time_s):
        raise OSError(28, "No space left on device")

    def close(self):
        super().close()
        raise OSError(28, "No space left on device")


def _sink(path, writer=RecordingWriter):
    return AnnotatedVideoSink(path, ["person"], 25.0, open_writer=writer)


def test_frames_keep_their_time_and_show_their_tracks(tmp_path):
    with _sink(tmp_path / "v.mp4") as sink:
        sink.write(make_frame(0, 0.0), make_tracks())
        sink.write(make_frame(3, 0.12), make_tracks([1], [BOX]))
    writer = sink._writer
    assert writer.times_s == [0.0, 0.12]
    assert writer.rate_hint == 25.0
    assert (writer.pictures[0] == 100).all()
    assert (writer.pictures[1] != 100).any()
    assert writer.close_calls == 1


def test_frame_is_not_modified(tmp_path):
    frame = make_frame()
    with _sink(tmp_path / "v.mp4") as sink:
        sink.write(frame, make_tracks([1], [BOX]))
    assert (frame.picture == 100).all()


def test_moving_object_has_a_trail(tmp_path):
    with _sink(tmp_path / "v.mp4") as sink:
        for index in range(3):
            sink.write(
                make_frame(index, index / 25, 120, 160), make_tracks([1], [[20 + 40 * index, 40, 40 + 40 * index, 80]])
            )
    last = sink._writer.pictures[-1]
    assert (last[79:82, 40:95] != 100).any()


def test_size_may_change_in_mid_stream(tmp_path):
    with _sink(tmp_path / "v.mp4") as sink:
        for index, (height, width) in enumerate([(60, 80), (120, 160), (61, 81)]):
            sink.write(make_frame(index, index / 25, height, width), make_tracks([1], [BOX]))
    assert [picture.shape[:2] for picture in sink._writer.pictures] == [(60, 80), (120, 160), (61, 81)]


def test_closing_twice_is_fine(tmp_path):
    sink = _sink(tmp_path / "v.mp4")
    sink.close()
    sink.close()
    assert sink._writer.close_calls == 1


def test_full_disk_names_the_file_and_the_sink_still_closes(tmp_path):
    sink = _sink(tmp_path / "v.mp4", FullDiskWriter)
    with pytest.raises(OutputError, match=r"v\.mp4: cannot be written \(No space left on device\)"):
        sink.write(make_frame(), make_tracks())
    sink.close()
    assert sink._writer.close_calls == 1


def test_fault_at_the_end_is_told_when_nothing_failed_before(tmp_path):
    sink = _sink(tmp_path / "v.mp4", FullDiskWriter)
    with pytest.raises(OutputError, match=r"v\.mp4"):
        sink.close()
    sink.close()


def test_folder_that_is_not_there_is_named(tmp_path):
    with (
        pytest.raises(OutputError, match=r"nowhere/v\.mp4"),
        AnnotatedVideoSink(tmp_path / "nowhere/v.mp4", [], 25.0) as sink,
    ):
        sink.write(make_frame(), make_tracks())


def test_video_comes_back_with_all_frames_and_the_drawing(tmp_path):
    path = tmp_path / "v.mp4"
    with AnnotatedVideoSink(path, ["person"], 25.0) as sink:
        for index in range(5):
            height, width = (60, 80) if index < 3 else (120, 160)
            sink.write(make_frame(index, index / 25, height, width), make_tracks([1], [BOX]))
    with av.open(str(path)) as container:
        frames = [(frame.time, frame.to_ndarray(format="rgb24")) for frame in container.decode(video=0)]
    assert np.allclose([time_s for time_s, _ in frames], np.arange(5) / 25, atol=0.002)
    assert {picture.shape for _, picture in frames} == {(60, 80, 3)}
    assert np.abs(frames[0][1].astype(int) - 100).max() > 50
