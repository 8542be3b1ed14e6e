from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cli.processes import lookonce
from lookonce.datasets import open_sequences, open_stills
from lookonce.errors import ConfigError, OutputError
from lookonce.synthetic import SyntheticFrame, SyntheticScene, WriteOptions, write_scene
from lookonce.synthetic.fleet import CLASSES
from lookonce.video import open_video
from synthetic.scenes import small_config


def make_scene(fps: float = 10.0) -> SyntheticScene:
    return SyntheticScene(small_config(seed=3, place="highway", fps=fps, seconds=3 / fps, height=180, width=320))


def make_frames(scene: SyntheticScene) -> list[SyntheticFrame]:
    return list(scene)


def test_mot_reads_back_as_it_was(tmp_path):
    scene = make_scene()
    calls = []
    written = write_scene(scene, tmp_path, "mot", lambda done, total: calls.append((done, total)))
    assert calls == [(1, 3), (2, 3), (3, 3)]
    (sequence,) = open_sequences(tmp_path)
    assert sequence.name == written.name == "synth-0003"
    assert sequence.classes == scene.classes
    assert sequence.fps == scene.fps
    assert sequence.left_out == {}
    np.testing.assert_array_equal(sequence.ignored, scene.ignored)
    frames = make_frames(scene)
    assert written.rows == sum(len(frame.objects) for frame in frames) > 20
    assert written.pictures == len(sequence.frames) == 3
    for truth, frame in zip(sequence.frames, frames, strict=True):
        assert truth.index == frame.index
        np.testing.assert_array_equal(truth.objects.identities, frame.objects.identities)
        np.testing.assert_array_equal(truth.objects.labels, frame.objects.labels)
        np.testing.assert_allclose(truth.objects.xyxy, frame.objects.xyxy, atol=0.02)
        np.testing.assert_allclose(truth.objects.visibility, frame.objects.visibility, atol=1e-3)
    with open_video(sequence.pictures) as video:
        assert [picture.image.shape for picture in video] == [(180, 320, 3)] * 3


def test_ua_detrac_reads_back_as_it_was(tmp_path):
    scene = make_scene(25.0)
    written = write_scene(scene, tmp_path, "ua-detrac", options=WriteOptions(part="test"))
    assert written.path == tmp_path / "DETRAC-Test-Annotations-XML" / "MVI_90003.xml"
    assert (tmp_path / "Insight-MVT_Annotation_Test" / "MVI_90003" / "img00001.jpg").is_file()
    (sequence,) = open_sequences(tmp_path / "DETRAC-Test-Annotations-XML")
    assert sequence.layout == "ua-detrac"
    np.testing.assert_array_equal(sequence.ignored, scene.ignored)
    omitted = 0
    for truth, frame in zip(sequence.frames, make_frames(scene), strict=True):
        is_kept = np.isin(frame.objects.labels, [CLASSES.index(name) for name in ("car", "bus", "truck")])
        omitted += int((~is_kept).sum())
        kept = frame.objects[is_kept]
        np.testing.assert_array_equal(truth.objects.identities, kept.identities)
        np.testing.assert_allclose(truth.objects.xyxy, kept.xyxy, atol=0.02)
        np.testing.assert_allclose(truth.objects.visibility, kept.visibility, atol=0.01)
        kinds = [kind for kind, is_one in zip(frame.truth.kinds, is_kept.tolist(), strict=True) if is_one]
        for kind, label in zip(kinds, truth.objects.labels.tolist(), strict=True):
            assert (sequence.classes[label] == "van") == (kind in ("van", "minibus"))
    assert written.left_out.get("not a vehicle of UA-DETRAC", 0) == omitted
    text = written.path.read_text()
    assert "@" not in text
    assert not list(written.path.parent.glob("*.part"))
    assert 'trajectory_length="3"' in text


def test_yolo_reads_back_as_it_was(tmp_path):
    scene = make_scene()
    options = WriteOptions(every=2, min_visibility=0.3)
    written = write_scene(scene, tmp_path, "yolo", options=options)
    stills = open_stills(tmp_path)
    assert stills.classes == scene.classes
    assert stills.left_out == {}
    frames = [frame for frame in make_frames(scene) if frame.index % 2 == 0]
    assert written.pictures == len(stills.pictures) == len(frames) == 2
    for objects, frame in zip(stills.objects, frames, strict=True):
        kept = frame.objects[frame.objects.visibility >= 0.3]
        np.testing.assert_array_equal(objects.labels, kept.labels)
        np.testing.assert_allclose(objects.xyxy, kept.xyxy, atol=0.01)
    write_scene(make_scene(), tmp_path, "yolo", options=WriteOptions(name="another", every=3))
    assert len(open_stills(tmp_path).pictures) == 3


def test_a_video_shows_the_same_frames(tmp_path):
    scene = make_scene()
    write_scene(scene, tmp_path, "mot", options=WriteOptions(has_video=True))
    with open_video(tmp_path / "synth-0003.mp4") as video:
        frames = list(video)
    assert len(frames) == 3
    assert frames[1].time_s == pytest.approx(0.1, abs=1e-3)
    difference = np.abs(frames[0].image.astype(int) - next(iter(scene)).image.astype(int))
    assert difference.mean() < 8


def test_earlier_files_are_kept_unless_told_otherwise(tmp_path):
    scene = make_scene()
    for layout in ("mot", "yolo"):
        write_scene(scene, tmp_path / layout, layout)
        with pytest.raises(OutputError, match="--overwrite"):
            write_scene(scene, tmp_path / layout, layout)
        write_scene(scene, tmp_path / layout, layout, options=WriteOptions(overwrite=True))
    (sequence,) = open_sequences(tmp_path / "mot")
    assert len(sequence.frames) == 3


def test_what_was_written_before_an_interruption_is_valid(tmp_path):
    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_scene(make_scene(), tmp_path, "mot", stop)
    (sequence,) = open_sequences(tmp_path)
    assert [frame.index for frame in sequence.frames] == [0, 1]


@pytest.mark.parametrize(
    ("layout", "options", "named"),
    [
        pytest.param("coco", {}, "mot, ua-detrac, yolo", id="layout"),
        pytest.param("mot", {"every": 2}, "every", id="thinned-sequence"),
        pytest.param("yolo", {"has_video": True}, "video", id="video-of-stills"),
        pytest.param("ua-detrac", {}, "25", id="frame-rate"),
        pytest.param("mot", {"name": "../up"}, "name", id="name"),
        pytest.param("mot", {"quality": 0}, "quality", id="quality"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_is_written(tmp_path, layout, options, named):
    scene = SyntheticScene(small_config())
    with pytest.raises(ConfigError, match=named):
        write_scene(scene, tmp_path / "out", layout, options=WriteOptions(**options))
    assert not (tmp_path / "out").exists()


def test_a_place_that_cannot_be_written_is_one_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        write_scene(SyntheticScene(small_config()), tmp_path / "file" / "out", "mot")


def test_the_command_divides_sequences_and_says_what_it_left_out(tmp_path: Path):
    size = ("--size", "160x90", "--minutes", 0.0014)
    result = lookonce("synth", tmp_path, "--layout", "ua-detrac", "--sequences", 2, "--light", "any", *size)
    assert result.returncode == 0, result.stderr
    assert "2 sequences, 4 pictures" in result.stdout
    assert "left out" in result.stdout
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"DETRAC-{part}-Annotations-XML" for part in ("Test", "Train")] + [
        f"Insight-MVT_Annotation_{part}" for part in ("Test", "Train")
    ]
    with Image.open(tmp_path / "Insight-MVT_Annotation_Train" / "MVI_90000" / "img00002.jpg") as image:
        assert image.size == (160, 90)
    again = lookonce("synth", tmp_path, "--layout", "ua-detrac", *size)
    assert again.returncode == 1
    assert len(again.stderr.strip().splitlines()) == 1
    assert "--overwrite" in again.stderr


@pytest.mark.parametrize("arguments", [("--size", "big"), ("--light", "noon"), ("--layout", "coco"), ("--size", "9x9")])
def test_the_command_answers_bad_settings_with_one_line(tmp_path, arguments):
    result = lookonce("synth", tmp_path / "out", *arguments)
    assert result.returncode == 1
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
