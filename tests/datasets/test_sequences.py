"""Which sequences are found, where their pictures are, and real ones."""

from __future__ import annotations

from functools import partial

import pytest

from datasets.making import refusal, write, write_detrac, write_mot, write_picture, write_pictures
from lookonce import open_video
from lookonce.datasets import open_sequences
from lookonce.errors import ConfigError, FormatError, VideoError

ROW = "1,7,10,5,20,10\n"


def count(sequence):
    return sum(len(frame.objects) for frame in sequence.frames)


def identities(sequence):
    return {identity for frame in sequence.frames for identity in frame.objects.identities.tolist()}


@pytest.mark.parametrize("below", ["", "train"])
def test_root_of_sequences_is_read_in_natural_order(tmp_path, below):
    for name in ("S10", "S2"):
        write_mot(tmp_path / below / name, f"{ROW.strip()},1,{len(name)}\n")
    first, second = open_sequences(tmp_path)
    assert (first.name, second.name) == ("S2", "S10")
    assert first.classes == second.classes == ("class 2", "class 3")
    assert second.frames[0].objects.labels.tolist() == [1]


def test_truth_file_itself_can_be_named(tmp_path, monkeypatch):
    folder = write_mot(tmp_path / "a", ROW)
    assert open_sequences(folder / "gt" / "gt.txt")[0].name == "a"
    monkeypatch.chdir(folder)
    (sequence,) = open_sequences(type(tmp_path)())
    assert (sequence.name, len(list(open_video(sequence.pictures)))) == ("a", 3)


def test_same_call_gives_the_same_twice(tmp_path):
    folder = write_mot(tmp_path / "a", ROW + "3,1,1,1,2,2\n")
    first, second = open_sequences(folder), open_sequences(folder)
    assert repr(first) == repr(second)


def test_broken_sequence_of_a_root_is_named(tmp_path):
    write_mot(tmp_path / "S1", ROW)
    write_mot(tmp_path / "S2", "1,2,x\n")
    assert refusal(FormatError, partial(open_sequences, tmp_path)).startswith(f"{tmp_path}/S2/gt/gt.txt:1: ")


def test_sequences_of_one_name_are_refused(tmp_path):
    for part in ("train", "val"):
        write_mot(tmp_path / part / "S1", ROW)
    assert "two sequences are called S1: " in refusal(ConfigError, partial(open_sequences, tmp_path))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        pytest.param(lambda path: path / "none", "none: no such folder or file; check the spelling", id="missing"),
        pytest.param(lambda path: path, "no truth is recognised here; looked for gt/gt.txt (MOTChallenge", id="empty"),
        pytest.param(lambda path: write(path / "a.txt", ROW), "a.txt: not a truth file that is known", id="other-file"),
        pytest.param(
            lambda path: write_pictures(path / "a", ["a.png"]), "a: no truth is recognised here", id="pictures-only"
        ),
        pytest.param(
            lambda path: write(path / "label_02" / "x.csv", "").parents[1], "no truth is recognised", id="no-labels"
        ),
    ],
)
def test_unknown_layout_says_what_was_looked_for(tmp_path, make, message):
    assert message in refusal(ConfigError, partial(open_sequences, make(tmp_path)))


def test_pictures_elsewhere_are_taken_as_a_folder_or_a_sequence_folder(tmp_path):
    folder = write_mot(tmp_path / "a", ROW, pictures=0)
    other = write_mot(tmp_path / "b", ROW)
    for given in (other, other / "img1"):
        assert open_sequences(folder, pictures=given)[0].pictures == other / "img1"


def test_video_has_its_own_clock_and_its_size_cuts_boxes(tmp_path, square_clip):
    folder = write_mot(tmp_path / "a", ROW + "2000,7,1,1,5000,5000\n", pictures=0)
    write(folder / "seqinfo.ini", "[Sequence]\nframeRate=30\n")
    (sequence,) = open_sequences(folder, pictures=square_clip)
    height, width = open_video(square_clip).size
    assert (sequence.pictures, sequence.fps) == (square_clip, None)
    assert sequence.frames[1].index == 1999
    assert sequence.frames[1].objects.xyxy.tolist() == [[1, 1, width, height]]


def test_video_of_another_size_than_stated_is_refused(tmp_path, square_clip):
    folder = write_mot(tmp_path / "a", ROW, pictures=0)
    write(folder / "seqinfo.ini", "[Sequence]\nimWidth=6\nimHeight=5\n")
    said = refusal(FormatError, partial(open_sequences, folder, pictures=square_clip))
    assert "seqinfo.ini: says that the pictures have 6 x 5 px" in said


def test_pictures_for_several_sequences_are_refused(tmp_path):
    for name in ("S1", "S2"):
        write_mot(tmp_path / name, ROW)
    said = refusal(ConfigError, partial(open_sequences, tmp_path, pictures=tmp_path / "S1"))
    assert said == f"{tmp_path}: holds 2 sequences, and pictures fit one only; name one sequence"


def test_pictures_that_cannot_be_are_refused(tmp_path):
    folder = write_mot(tmp_path / "a", ROW)
    picture = write_picture(tmp_path / "b.png")
    read = partial(open_sequences, folder)
    assert "b.png: a single picture" in refusal(ConfigError, partial(read, pictures=picture))
    assert "none: no such pictures for" in refusal(VideoError, partial(read, pictures=tmp_path / "none"))
    text = write(tmp_path / "c.txt", "hello")
    assert "c.txt: " in refusal(VideoError, partial(read, pictures=text))


def test_mixed_root_has_sequences_of_both_layouts(tmp_path):
    write_mot(tmp_path / "b", ROW)
    box = '<box left="1" top="1" width="9" height="9"/>'
    xml = f'<sequence name="a"><frame num="1"><target_list><target id="1">{box}<attribute vehicle_type="car"/>'
    write_detrac(tmp_path / "a", f"{xml}</target></target_list></frame></sequence>")
    first, second = open_sequences(tmp_path)
    assert (first.layout, second.layout) == ("ua-detrac", "motchallenge")
    assert first.classes == second.classes == ("car", "object")


@pytest.mark.data
def test_pets_is_read_whole(data_folder):
    (sequence,) = open_sequences(data_folder / "sequences" / "PETS09-S2L1")
    assert (len(sequence.frames), count(sequence), len(identities(sequence))) == (795, 4650, 19)
    assert (sequence.layout, sequence.classes, sequence.left_out) == ("motchallenge", ("object",), {})
    assert sequence.frames[-1].index == 794


@pytest.mark.data
def test_highway_is_the_same_in_both_layouts(data_folder):
    folder, clip = data_folder / "sequences" / "highway2", data_folder / "videos" / "haarcascades_video2.avi"
    (mot,) = open_sequences(folder, pictures=clip)
    (detrac,) = open_sequences(folder / "highway2.xml", pictures=clip)
    for sequence in (mot, detrac):
        assert (len(sequence.frames), count(sequence), len(identities(sequence))) == (750, 3370, 48)
        assert sequence.ignored.tolist() == [[0, 0, 320, 46], [0, 46, 84, 145]]
        assert (sequence.pictures, sequence.fps, sequence.left_out) == (clip, None, {})
    assert mot.classes == ("class 1", "class 2", "class 4")
    assert all(
        one.objects.xyxy.tolist() == other.objects.xyxy.tolist()
        for one, other in zip(mot.frames, detrac.frames, strict=True)
    )


@pytest.mark.data
def test_highway_without_its_clip_says_what_to_do(data_folder):
    said = refusal(VideoError, partial(open_sequences, data_folder / "sequences" / "highway2"))
    assert "highway2/img1: no such pictures for" in said
    assert "name them (pictures)" in said


@pytest.mark.data
def test_real_detrac_annotation_is_read(data_folder):
    (sequence,) = open_sequences(data_folder / "sequences" / "UA-DETRAC-MVI_20011-9frames")
    assert (sequence.name, sequence.layout, sequence.fps, sequence.classes) == ("MVI_20011", "ua-detrac", 25, ("car",))
    assert [(frame.index, len(frame.objects)) for frame in sequence.frames] == [(0, 2), (1, 3)]
    assert sequence.ignored.shape == (7, 4)
    assert sequence.ignored[:, 2].max() == 960
    assert sequence.frames[1].objects.visibility.tolist() == pytest.approx([1, 1, 1 - 27.35 * 1.69 / (35.7 * 30.6)])
