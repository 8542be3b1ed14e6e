import signal
from pathlib import Path

import numpy as np
import pytest

import lookonce
import lookonce.video
from lookonce.pipeline import StageTimes, share_processors, track_video, tracker_for
from squares import write_clip


def rows(frames):
    return [
        (f.index, round(f.time_s, 6), f.tracks.ids.tolist(), f.tracks.xyxy.tobytes(), f.tracks.scores.tobytes())
        for f in frames
    ]


def test_each_square_keeps_its_id_through_the_clip(square_clip: Path, square_model: Path) -> None:
    seen: dict[int, set[float]] = {}
    for frame in lookonce.track(square_clip, square_model, "paper"):
        assert [t.id for t in frame.tracks] == [1, 2, 3]
        for t in frame.tracks:
            seen.setdefault(t.id, set()).add(round(float(t.xyxy[1])))
    assert seen == {1: {24}, 2: {48}, 3: {8}}  # every square moves in its own row


def test_names_times_and_images_come_with_the_frame(square_clip: Path, square_model: Path) -> None:
    frames = list(lookonce.track(square_clip, square_model, "paper"))
    assert [f.index for f in frames] == list(range(12))
    assert [round(f.time_s, 3) for f in frames] == [round(i / 10, 3) for i in range(12)]
    assert {t.name for t in frames[0].tracks} == {"red", "other"}
    assert frames[3].image.shape == (64, 64, 3)


def test_classes_can_be_chosen_by_name(square_clip: Path, square_model: Path) -> None:
    frames = list(lookonce.track(square_clip, square_model, classes=["red"]))
    assert {t.name for f in frames for t in f.tracks} == {"red"}


@pytest.mark.parametrize("workers", [1, 2, 3, 7])
def test_results_do_not_depend_on_how_many_frames_are_inferred_at_once(
    square_clip: Path, square_model: Path, workers: int
) -> None:
    model = lookonce.Model(square_model, threads=1)

    def run(count: int):
        with lookonce.open_video(square_clip) as video:
            return rows(track_video(video, model, tracker_for(model), workers=count))

    assert run(workers) == run(1)


@pytest.mark.parametrize("workers", [1, 3])
def test_who_looks_as_a_model_does_gets_frames_and_pictures_that_belong_together(
    square_clip: Path, square_model: Path, workers: int
) -> None:
    class Wrapped:
        """A detector of somebody else that takes letterboxed pictures."""

        def __init__(self, model: lookonce.Model) -> None:
            self.names, self.size, self.model, self.seen = model.names, model.size, model, []

        def detect(self, frame: lookonce.Frame) -> lookonce.Detections:
            raise AssertionError("it can look at the letterboxed picture")

        def look(self, frame, canvas, placed) -> lookonce.Detections:
            self.seen.append((frame.index, canvas.shape))
            (found,) = self.model.run(canvas[np.newaxis], [placed])
            assert found.xyxy.tolist() == self.model.detect(frame).xyxy.tolist()
            return found

    model = lookonce.Model(square_model, threads=1)
    wrapped, times = Wrapped(model), StageTimes()
    with lookonce.open_video(square_clip) as video:
        found = rows(track_video(video, wrapped, tracker_for(model), workers=workers, times=times))
    with lookonce.open_video(square_clip) as video:
        assert found == rows(track_video(video, model, tracker_for(model)))
    assert sorted(wrapped.seen) == [(index, (64, 64, 3)) for index in range(12)]
    assert times.seconds["detect"] > 0


def test_every_and_max_frames_choose_frames_by_index(square_clip: Path, square_model: Path) -> None:
    frames = list(lookonce.track(square_clip, square_model, every=3, max_frames=3))
    assert [f.index for f in frames] == [0, 3, 6]


def test_the_parts_by_hand_give_what_track_gives(tmp_path: Path, square_model: Path) -> None:
    from squares import picture

    clip = tmp_path / "grey.mp4"  # coloured edges, where scaling YUV and scaling RGB differ
    with lookonce.video.VideoWriter(clip, 10) as writer:
        for index in range(6):
            writer.write(np.kron(picture(index), np.ones((3, 5, 1), np.uint8)) // 2 + 40, index / 10)
    model, tracker = lookonce.Model(square_model, score_threshold=0.01), lookonce.Tracker("paper")
    by_hand = [tracker.update(model.detect(frame), frame.time_s) for frame in lookonce.open_video(clip)]
    at_once = [frame.tracks for frame in lookonce.track(clip, model, "paper")]
    assert len(by_hand) == len(at_once) == 6
    for ours, theirs in zip(by_hand, at_once, strict=True):
        assert ours.ids.tolist() == theirs.ids.tolist()
        assert ours.scores.tobytes() == theirs.scores.tobytes()


def test_two_streams_at_once_do_not_meet(square_clip: Path, square_model: Path) -> None:
    alone = rows(lookonce.track(square_clip, square_model))
    pairs = zip(lookonce.track(square_clip, square_model), lookonce.track(square_clip, square_model), strict=True)
    first, second = zip(*pairs, strict=True)
    assert rows(first) == alone
    assert rows(second) == alone


def test_leaving_the_loop_early_ends_the_threads(square_clip: Path, square_model: Path) -> None:
    import threading

    before = threading.active_count()
    frames = lookonce.track(square_clip, square_model)
    next(frames)
    frames.close()
    assert threading.active_count() == before


def test_an_error_in_a_sink_reaches_the_caller(square_clip: Path, square_model: Path) -> None:
    class FullDisk:
        path = Path("full")

        def write(self, frame, tracks):
            raise lookonce.OutputError("full: no space left")

    model = lookonce.Model(square_model)
    with lookonce.open_video(square_clip) as video, pytest.raises(lookonce.OutputError, match="no space"):
        list(track_video(video, model, tracker_for(model), workers=2, sinks=[FullDisk()]))


def test_stage_times_count_every_frame(square_clip: Path, square_model: Path) -> None:
    times, model = StageTimes(), lookonce.Model(square_model)
    with lookonce.open_video(square_clip) as video:
        list(track_video(video, model, tracker_for(model), times=times))
    assert times.frames == 12
    assert all(times.seconds[stage] > 0 for stage in ("decode", "letterbox", "detect", "associate"))


def test_a_frame_size_change_keeps_boxes_in_the_frames_own_pixels(tmp_path: Path, square_model: Path) -> None:
    from squares import picture

    folder = tmp_path / "frames"
    folder.mkdir()
    from PIL import Image

    Image.fromarray(picture(0)).save(folder / "1.png")
    Image.fromarray(np.kron(picture(1), np.ones((2, 2, 1), np.uint8))).save(folder / "2.png")
    small, large = lookonce.track(folder, square_model)
    assert small.tracks.xyxy.max() <= 64
    assert sorted(np.rint(large.tracks.xyxy[:, 1]).tolist()) == [16, 48, 96]


def test_a_calibrated_threshold_is_used_unless_one_is_given(square_model: Path) -> None:
    model = lookonce.Model(square_model)
    assert tracker_for(model).config.match_threshold == lookonce.PaperConfig().match_threshold
    assert tracker_for(model, match_threshold=0.2).config.match_threshold == 0.2


@pytest.mark.parametrize(
    ("is_live", "threads", "provider", "processors", "expected"),
    [
        pytest.param(False, None, "cpu", 1, (1, 1), id="one processor"),
        pytest.param(False, None, "cpu", 2, (1, 2), id="two processors"),
        pytest.param(False, None, "cpu", 16, (4, 4), id="many processors"),
        pytest.param(False, 2, "cpu", 2, (2, 1), id="threads chosen"),
        pytest.param(True, None, "cpu", 8, (8, 1), id="live"),
        pytest.param(False, None, "cuda", 8, (8, 1), id="gpu"),
    ],
)
def test_processors_are_shared_out(monkeypatch, is_live, threads, provider, processors, expected) -> None:
    monkeypatch.setattr("lookonce.pipeline.available_cpus", lambda: processors)
    assert share_processors(is_live, threads, provider) == expected


def test_missing_descriptors_are_explained(tmp_path: Path) -> None:
    from lookonce.make.darknet.importer import import_darknet
    from squares import write_darknet

    cfg, weights, names = write_darknet(tmp_path)
    import_darknet(cfg, weights, tmp_path / "plain.onnx", names=names, descriptors=False)
    clip = write_clip(tmp_path / "clip.mp4", frames=2)
    with pytest.raises(lookonce.ConfigError, match=r"plain\.onnx.*no descriptors"):
        list(lookonce.track(clip, tmp_path / "plain.onnx", "paper"))
    assert len(list(lookonce.track(clip, tmp_path / "plain.onnx"))) == 2  # the default preset can do without


@pytest.mark.usefixtures("usual_interrupts")
def test_an_interrupt_in_mid_write_loses_no_sink_a_frame(square_clip: Path, square_model: Path) -> None:
    written: list[list[int]] = [[], []]

    class Interrupted:
        def __init__(self, number: int) -> None:
            self.number = number

        def write(self, frame, tracks) -> None:
            if self.number == 0 and frame.index == 3:
                signal.raise_signal(signal.SIGINT)
            written[self.number].append(frame.index)

    model = lookonce.Model(square_model)
    with lookonce.video.open_video(square_clip) as video, pytest.raises(KeyboardInterrupt):
        for _ in track_video(video, model, tracker_for(model), sinks=[Interrupted(0), Interrupted(1)]):
            pass
    assert written == [[0, 1, 2, 3], [0, 1, 2, 3]]


@pytest.mark.parametrize("follows_camera", [True, False])
def test_a_still_camera_gives_the_same_tracks_with_and_without_its_motion(
    square_clip: Path, square_model: Path, follows_camera: bool
) -> None:
    model = lookonce.Model(square_model)
    with lookonce.open_video(square_clip) as video:
        found = list(track_video(video, model, tracker_for(model), follows_camera=follows_camera))
    with lookonce.open_video(square_clip) as video:
        assert rows(found) == rows(track_video(video, model, tracker_for(model)))
