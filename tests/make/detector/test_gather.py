"""What there is to learn from: which classes a picture tells of, what a teacher adds, what is held out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from datasets.making import refusal
from lookonce.datasets import open_sequences, open_stills
from lookonce.errors import ConfigError, OutputError, VideoError
from lookonce.make.detector import gather as gather_module
from lookonce.make.detector.gather import DetectorData, Gathered, gather
from lookonce.structures import Detections
from lookonce.video import VideoWriter
from make.detector.rectangles import CONFIG, SIZE, data_of, write_rectangles
from make.training.scenes import Watcher, make_detections, write_labelled

CLASSES = ("red", "blue", "cat")


@dataclass
class Teacher:
    """Sees the same in every picture."""

    names: tuple[str, ...] = ("cat", "blue")
    found: Detections = field(default_factory=lambda: make_detections([]))
    seen: list[tuple[int, ...]] = field(default_factory=list)

    def detect(self, image: np.ndarray) -> Detections:
        self.seen.append(image.shape)
        return self.found


def run(data, folder, *, classes=CLASSES, config=CONFIG, teacher=None, watcher=None) -> Gathered:
    watcher = watcher or Watcher()
    return gather(data, classes, config, teacher, folder, size=(SIZE, SIZE), report=watcher.stage, say=watcher.say)


@pytest.fixture(scope="module")
def stills(tmp_path_factory) -> Path:
    """24 pictures with red and blue rectangles."""
    return write_rectangles(tmp_path_factory.mktemp("data") / "boxes", 24)


@pytest.fixture(scope="module")
def reds(tmp_path_factory) -> Path:
    """24 pictures with red and blue rectangles, of which only the red ones are labelled."""
    return write_rectangles(tmp_path_factory.mktemp("data") / "reds", 24, labels=(0,))


@pytest.fixture(scope="module")
def walk(tmp_path_factory) -> Path:
    """A sequence of 12 frames with three squares."""
    return write_labelled(tmp_path_factory.mktemp("data") / "walk")


def test_classes_that_occur_are_labelled(stills, reds, tmp_path):
    found = run(data_of(stills, reds), tmp_path)
    masks = {s.picture.parent.parent.name: s.labelled.tolist() for s in found.training + found.validation}
    assert masks == {"boxes": [True, True, False], "reds": [True, False, False]}
    assert len(found.training) + len(found.validation) == 48
    assert found.classes == CLASSES
    sample = found.training[0]
    truth = open_stills(stills)
    number = truth.pictures.index(sample.picture)
    assert sample.xyxy.tolist() == truth.objects[number].xyxy.tolist()
    assert sample.labels.tolist() == truth.objects[number].labels.tolist()
    assert sample.ignored.shape == (0, 4)


def test_what_is_labelled_can_be_told(reds, tmp_path):
    data = data_of(reds, labelled={"reds": ("cat", "red")})
    assert run(data, tmp_path).training[0].labelled.tolist() == [True, False, True]
    nothing = run(replace(data_of(reds), labelled={"reds": ()}), tmp_path, teacher=Teacher(CLASSES))
    assert nothing.training[0].labelled.all()


def test_classes_that_are_not_learnt_are_left_out_and_names_are_matched_as_usual(stills, tmp_path):
    found = run(data_of(stills), tmp_path, classes=("Blue",))
    assert all(len(s.labels) == 1 and s.labels[0] == 0 and s.labelled.tolist() == [True] for s in found.training)
    folder = write_rectangles(tmp_path / "bikes", 24, names=("Motorbike", "aeroplane"))
    found = run(data_of(folder), tmp_path, classes=("airplane", "motorcycle"))
    assert sorted(found.training[0].labels.tolist()) == [0, 1]
    theirs = open_stills(folder).objects[0].labels
    first = next(s for s in found.training + found.validation if s.picture.stem == "000")
    assert first.labels.tolist() == [1 - n for n in theirs]


def test_two_names_of_one_class_are_refused(stills, tmp_path):
    """Every label went to the second of them, and the first was learnt from nothing."""
    message = refusal(ConfigError, lambda: run(data_of(stills), tmp_path, classes=("motorbike", "Motorcycle")))
    assert message == "classes 'motorbike' and 'Motorcycle' are one; name the classes with --names, or rename one"


def test_unknown_names_are_one_line(stills, tmp_path):
    message = refusal(ConfigError, lambda: run(data_of(stills, labelled={"box": ("red",)}), tmp_path))
    assert message == "labelled 'box': no such set; expected one of boxes"
    message = refusal(ConfigError, lambda: run(data_of(stills, labelled={"boxes": ("red", "dog")}), tmp_path))
    assert message == "labelled 'boxes': 'dog' is no class here; expected red, blue, cat"


def test_pictures_of_the_list_are_left_out(stills, tmp_path):
    endings = frozenset(["boxes/images/003.png", "004.png", "mages/005.png", "other/images/006.png", "images/007.png"])
    found = run(data_of(stills, left_out=endings), tmp_path)
    stems = {s.picture.stem for s in found.training + found.validation}
    assert {f"{n:03d}" for n in range(24)} - stems == {"003", "004", "007"}


def test_neighbouring_pictures_are_held_out_together(stills, tmp_path):
    found = run(data_of(stills), tmp_path)
    held = sorted(int(s.picture.stem) for s in found.validation)
    assert held in ([*range(8)], [*range(8, 16)], [*range(16, 24)])
    assert len(found.training) == 16
    assert not set(map(id, found.training)) & set(map(id, found.validation))
    many = write_rectangles(tmp_path / "many", 96)
    counts = {
        share: len(run(data_of(many), tmp_path, config=replace(CONFIG, held_out=share)).validation)
        for share in (0.01, 0.25, 0.5)
    }
    assert counts == {0.01: 8, 0.25: 24, 0.5: 48}
    other = [run(data_of(many), tmp_path, config=replace(CONFIG, seed=seed)).validation for seed in (0, 0, 1)]
    paths = [[s.picture for s in one] for one in other]
    assert paths[0] == paths[1] != paths[2]


def test_nothing_to_learn_from_or_to_validate_on_is_one_line(stills, tmp_path):
    few = write_rectangles(tmp_path / "few", 1)
    assert "no labelled object to validate on" in refusal(ConfigError, lambda: run(data_of(few), tmp_path))
    assert "no labelled object to learn from" in refusal(ConfigError, lambda: run(DetectorData(), tmp_path))
    bare = write_rectangles(tmp_path / "bare", 24, labels=())
    assert "no labelled object to learn from" in refusal(ConfigError, lambda: run(data_of(bare), tmp_path))
    assert "to learn from" in refusal(ConfigError, lambda: run(data_of(stills), tmp_path, classes=("dog",)))


def test_small_sets_are_divided_too(tmp_path):
    """A set of eight pictures or fewer could not be learnt from: all of it was one block."""
    for count, held in ((2, 1), (4, 1), (8, 2)):
        found = run(data_of(write_rectangles(tmp_path / str(count), count)), tmp_path)
        assert (len(found.training), len(found.validation)) == (count - held, held)


def test_sequences_are_held_out_whole_where_there_is_nothing_else(walk, tmp_path):
    """Without stills there was nothing to validate on."""
    (sequence,) = open_sequences(walk)
    five = tuple(replace(sequence, name=f"walk{n}") for n in range(5))
    counts = {}
    for number in (1, 2, 5):
        found = run(DetectorData(sequences=five[:number]), tmp_path, classes=sequence.classes)
        counts[number] = len(found.training), len(found.validation)
    frames = len(sequence.frames)
    assert counts == {1: (frames - 3, 3), 2: (frames, frames), 5: (4 * frames, frames)}


def test_objects_of_classes_that_are_not_labelled_do_not_count_for_validation(stills, tmp_path):
    """Average precision of nothing is no number, and no look was better than the first."""
    data = data_of(stills, labelled={"boxes": ("cat",)})
    assert "no labelled object to validate on" in refusal(ConfigError, lambda: run(data, tmp_path))


def test_findings_tell_what_a_set_holds(reds, walk, tmp_path):
    watcher = Watcher()
    run(replace(data_of(reds), sequences=open_sequences(walk)), tmp_path, watcher=watcher)
    assert watcher.findings == [
        "reds: 24 pictures, 24 red; says nothing of blue, cat",
        "walk: 12 pictures, no objects; says nothing of red, blue, cat",
    ]


# --- sequences and videos ---


def test_frames_of_a_sequence_are_written_once_and_used_again(stills, walk, tmp_path):
    classes = (*CLASSES, *open_sequences(walk)[0].classes)
    data = replace(data_of(stills), sequences=open_sequences(walk))
    found = run(data, tmp_path, classes=classes)
    frames = [s for s in found.training if "frames" in s.picture.parts]
    assert [s.picture.name for s in frames] == [f"{n:06d}.jpg" for n in range(12)]
    for number, sample in enumerate(frames):
        assert sample.xyxy.tolist() == data.sequences[0].frames[number].objects.xyxy.tolist()
        assert sample.labelled.tolist() == [False, False, False, True]
        assert sample.labels.tolist() == [3] * 3
        assert sample.ignored.tolist() == data.sequences[0].ignored.tolist()
        with Image.open(sample.picture) as picture:
            assert picture.size == (64, 64)
    before = {s.picture: s.picture.stat().st_mtime_ns for s in frames}
    again = run(data, tmp_path, classes=classes)
    assert {s.picture: s.picture.stat().st_mtime_ns for s in again.training if s.picture in before} == before
    assert not list(tmp_path.rglob("*.unfinished"))


@pytest.mark.parametrize(("limit", "expected"), [(1, [0]), (3, [0, 6, 11]), (12, [*range(12)]), (99, [*range(12)])])
def test_frames_are_spread_evenly(stills, walk, tmp_path, limit, expected):
    data = replace(data_of(stills), sequences=open_sequences(walk))
    watcher = Watcher()
    found = run(data, tmp_path, config=replace(CONFIG, video_frames=limit), watcher=watcher)
    frames = [int(s.picture.stem) for s in found.training if "frames" in s.picture.parts]
    assert frames == expected
    assert watcher.stages[-1][:3] == ("frames of walk", len(expected), len(expected))


def write_clip(path: Path, grey: int, frames: int = 5) -> Path:
    path.parent.mkdir(exist_ok=True)
    with VideoWriter(path, 10.0) as writer:
        for index in range(frames):
            writer.write(np.full((64, 64, 3), grey, np.uint8), index / 10)
    return path


def frames_of(found: Gathered) -> list[Path]:
    return [s.picture for s in found.training if "frames" in s.picture.parts]


def brightness(paths: list[Path]) -> list[int]:
    return [round(float(np.asarray(Image.open(path)).mean()) / 50) * 50 for path in paths]


def test_videos_of_one_name_do_not_share_their_frames(stills, tmp_path):
    """Frames were kept by the video's name only: those of the second video were the first's."""
    videos = write_clip(tmp_path / "a" / "street.mp4", 50), write_clip(tmp_path / "b" / "street.mp4", 200)
    teacher = Teacher(found=make_detections([[5, 5, 30, 30]]))
    found = run(replace(data_of(stills), videos=videos), tmp_path / "run", teacher=teacher)
    assert brightness(frames_of(found)) == [50] * 5 + [200] * 5


def test_frames_of_an_earlier_version_of_a_video_are_not_used(stills, tmp_path):
    """With --overwrite a run learnt from the pictures of the video that had been there before."""
    teacher = Teacher(found=make_detections([[5, 5, 30, 30]]))
    for grey in (50, 200):
        video = write_clip(tmp_path / "street.mp4", grey, frames=5 + grey // 100)
        found = run(replace(data_of(stills), videos=(video,)), tmp_path / "run", teacher=teacher)
        assert brightness(frames_of(found)) == [grey] * (5 + grey // 100)


def test_unlabelled_video_needs_a_teacher(stills, tmp_path):
    video = write_clip(tmp_path / "street.mp4", 50)
    message = refusal(ConfigError, lambda: run(replace(data_of(stills), videos=(video,)), tmp_path))
    assert message == f"{video}: has no labels; give --teacher MODEL.onnx, or label it"


def test_frames_in_which_the_teacher_sees_nothing_are_left_out(stills, tmp_path):
    video = write_clip(tmp_path / "street.mp4", 50)
    found = run(replace(data_of(stills), videos=(video,)), tmp_path, teacher=Teacher())
    assert frames_of(found) == []


def test_videos_that_cannot_be_read_are_one_line(stills, tmp_path):
    for name in ("gone.mp4", "text.mp4"):
        if name == "text.mp4":
            (tmp_path / name).write_text("hello")
        data = replace(data_of(stills), videos=(tmp_path / name,))
        assert name in refusal(VideoError, lambda data=data: run(data, tmp_path, teacher=Teacher()))


def test_a_full_disk_while_frames_are_written_is_one_line(stills, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    video = write_clip(tmp_path / "street.mp4", 50)
    monkeypatch.setattr(gather_module.Image.Image, "save", full)
    data = replace(data_of(stills), videos=(video,))
    assert "No space left on device" in refusal(OutputError, lambda: run(data, tmp_path, teacher=Teacher()))


# --- the teacher ---


def test_the_teacher_fills_in_classes_that_are_not_labelled(reds, tmp_path):
    corner = [[1.0, 1, 6, 6], [50, 50, 63, 63], [1, 50, 9, 63]]
    teacher = Teacher(("dog", "BLUE", "red"), make_detections(corner, labels=[0, 1, 2]))
    found = run(data_of(reds), tmp_path, teacher=teacher)
    for sample in found.training + found.validation:
        assert sample.labelled.tolist() == [True, True, False]  # the teacher knows no cats
        assert sample.labels.tolist() == [0, 1]  # red is labelled already, a dog is not learnt
        assert sample.xyxy[1].tolist() == corner[1]
    assert len(teacher.seen) == 24


def test_sure_detections_are_labels_and_doubtful_ones_are_ignored(reds, tmp_path):
    boxes = [[1.0, 1, 6, 6], [50, 50, 63, 63], [1, 50, 9, 63], [50, 1, 63, 9]]
    teacher = Teacher(found=make_detections(boxes, labels=[0, 0, 0, 0], scores=[0.5, 0.49, 0.15, 0.14]))
    config = replace(CONFIG, teacher_score=0.5, teacher_doubt=0.15)
    sample = run(data_of(reds), tmp_path, config=config, teacher=teacher).training[0]
    assert sample.xyxy[1:].tolist() == boxes[:1]
    assert sample.labels.tolist() == [0, 2]
    assert sample.ignored.tolist() == boxes[1:3]


def test_what_is_labelled_already_is_not_labelled_again(reds, tmp_path):
    """Whatever class the teacher takes it for: here it takes a red rectangle for a cat."""
    first = open_stills(reds).objects[0].xyxy[0]
    apart = first + np.float32([70, 70, 70, 70])
    shifted = first + np.float32([1, 0, 1, 0])
    for box, count in ((shifted, 1), (apart, 2)):
        teacher = Teacher(found=make_detections([box], labels=[0]))
        found = run(data_of(reds), tmp_path, teacher=teacher)
        sample = next(s for s in found.training + found.validation if s.picture.stem == "000")
        assert len(sample.labels) == count


def test_the_teacher_sees_large_pictures_smaller_and_its_boxes_are_those_of_the_file(tmp_path):
    folder = write_rectangles(tmp_path / "large", 16, size=(256, 320), labels=(0,))
    teacher = Teacher(found=make_detections([[10, 20, 30, 40]], labels=[0]))
    sample = run(data_of(folder), tmp_path, teacher=teacher).training[0]
    height, width, _ = teacher.seen[0]
    assert max(height, width) < 300
    np.testing.assert_allclose(
        sample.xyxy[-1], np.array([10, 20, 30, 40]) * np.tile([320 / width, 256 / height], 2), rtol=1e-5
    )


def test_a_teacher_of_other_classes_is_refused(reds, tmp_path):
    message = refusal(ConfigError, lambda: run(data_of(reds), tmp_path, teacher=Teacher(("dog", "horse"))))
    assert message == "the teacher knows none of the classes red, blue, cat"


def test_a_teacher_that_knows_nothing_more_is_not_asked(stills, tmp_path):
    teacher, watcher = Teacher(("red", "blue")), Watcher()
    run(data_of(stills), tmp_path, teacher=teacher, watcher=watcher)
    assert teacher.seen == []
    teacher = Teacher(("red", "cat"))
    run(data_of(stills), tmp_path, teacher=teacher, watcher=watcher)
    assert len(teacher.seen) == 24
    assert watcher.stages[-1] == ("teacher on boxes", 24, 24, "")


def test_objects_of_a_sequence_that_others_hide_are_ignored(walk, tmp_path):
    """An object of which nothing can be seen was taught as if it were there."""
    (sequence,) = open_sequences(walk)
    hidden = tuple(
        replace(frame, objects=replace(frame.objects, visibility=np.array([1, 0.3, 0.2], np.float32)))
        for frame in sequence.frames
    )
    found = run(DetectorData(sequences=(replace(sequence, frames=hidden),)), tmp_path, classes=sequence.classes)
    for sample in found.training:
        assert len(sample.xyxy) == len(sample.labels) == 2
        assert len(sample.ignored) == 1
