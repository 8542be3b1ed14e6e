"""UA-DETRAC sequences."""

from __future__ import annotations

import os
from functools import partial

import pytest

from datasets.making import annotation, frame, refusal, target, write, write_detrac, write_pictures
from lookonce.datasets import open_sequences
from lookonce.datasets.text import MAX_FILE_BYTES
from lookonce.errors import ConfigError, FormatError, VideoError

TRAIN = "Insight-MVT_Annotation_Train"
XML = "DETRAC-Train-Annotations-XML"
SIMPLE = annotation(frame(1, target()))


def write_root(root, names, *, xml=XML, images=TRAIN, suffix="", kind="car"):
    for name in names:
        write(root / xml / f"{name}{suffix}.xml", annotation(frame(1, target(kind=kind)), name=name))
        write_pictures(root / images / name, ["img00001.jpg", "img00002.jpg"])
    return root


def test_targets_become_objects(tmp_path):
    text = annotation(
        frame(1, target(4, kind="van"), target(2, 'left="60" top="40" width="20" height="20"')),
        frame(2),
        frame(3, target(4, kind="van", overlaps=['left="10" top="5" width="10" height="5"'])),
        ignored=['left="0.5" top="0" width="200" height="10"'],
    )
    (sequence,) = open_sequences(write_detrac(tmp_path, text))
    assert (sequence.name, sequence.layout, sequence.fps) == ("MVI_1", "ua-detrac", 25.0)
    assert sequence.pictures == tmp_path
    assert sequence.classes == ("car", "van")
    assert [f.index for f in sequence.frames] == [0, 1, 2]
    assert sequence.frames[0].objects.xyxy.tolist() == [[10, 5, 30, 15], [60, 40, 64, 48]]
    assert sequence.frames[0].objects.identities.tolist() == [4, 2]
    assert sequence.frames[0].objects.labels.tolist() == [1, 0]
    assert len(sequence.frames[1].objects) == 0
    assert sequence.ignored.tolist() == [[0.5, 0, 64, 10]]


@pytest.mark.parametrize(
    ("overlaps", "visibility"),
    [
        pytest.param([], 1, id="none"),
        pytest.param(['left="10" top="5" width="10" height="5"'], 0.75, id="a-quarter"),
        pytest.param(['left="10" top="5" width="10" height="5"'] * 2, 0.5, id="areas-add-up"),
        pytest.param(['left="0" top="0" width="99" height="99"'], 0, id="not-below-0"),
    ],
)
def test_visibility_is_what_others_leave_of_the_box(tmp_path, overlaps, visibility):
    (sequence,) = open_sequences(write_detrac(tmp_path, annotation(frame(1, target(overlaps=overlaps)))))
    assert sequence.frames[0].objects.visibility.tolist() == [visibility]


@pytest.mark.parametrize(
    ("xml", "images", "suffix"),
    [
        pytest.param(XML, TRAIN, "", id="train"),
        pytest.param("DETRAC-Test-Annotations-XML", "Insight-MVT_Annotation_Test", "", id="test"),
        pytest.param("DETRAC-Train-Annotations-XML-v3", f"DETRAC-train-data/{TRAIN}", "_v3", id="v3-nested-pictures"),
        pytest.param(f"{XML}/{XML}", TRAIN, "", id="unpacked-into-a-folder"),
    ],
)
def test_root_as_distributed_is_read(tmp_path, xml, images, suffix):
    write_root(tmp_path, ["MVI_20011", "MVI_3"], xml=xml, images=images, suffix=suffix)
    sequences = open_sequences(tmp_path)
    assert [sequence.name for sequence in sequences] == ["MVI_3", "MVI_20011"]
    assert [sequence.pictures for sequence in sequences] == [tmp_path / images / n for n in ("MVI_3", "MVI_20011")]
    assert len(open_sequences(tmp_path / xml)) == 2
    (one,) = open_sequences(tmp_path / xml / f"MVI_3{suffix}.xml")
    assert one.pictures == tmp_path / images / "MVI_3"


def test_classes_of_a_root_are_one_sorted_tuple(tmp_path):
    write_root(tmp_path, ["MVI_1"], kind="van")
    write_root(tmp_path, ["MVI_2"], kind="bus")
    first, second = open_sequences(tmp_path)
    assert first.classes == second.classes == ("bus", "van")
    assert first.frames[0].objects.labels.tolist() == [1]
    assert second.frames[0].objects.labels.tolist() == [0]


def test_pictures_are_found_in_a_sub_folder_or_a_sibling_of_one_file(tmp_path):
    write(tmp_path / "MVI_1.xml", SIMPLE)
    write_pictures(tmp_path / "MVI_1", ["img00001.jpg"])
    assert open_sequences(tmp_path)[0].pictures == tmp_path / "MVI_1"
    assert open_sequences(tmp_path / "MVI_1.xml")[0].pictures == tmp_path / "MVI_1"


def test_folders_of_single_sequences_are_a_root(tmp_path):
    for name in ("MVI_1", "MVI_2"):
        write_detrac(tmp_path / name, annotation(frame(1, target()), name=name), name=name)
    assert [sequence.name for sequence in open_sequences(tmp_path)] == ["MVI_1", "MVI_2"]


def test_two_annotations_of_one_sequence_are_refused(tmp_path):
    write_root(tmp_path, ["MVI_1"])
    write_root(tmp_path, ["MVI_1"], xml=f"{XML}-v3", suffix="_v3")
    said = refusal(ConfigError, partial(open_sequences, tmp_path))
    assert said.startswith("two sequences are called MVI_1: ")
    assert f"{XML}-v3/MVI_1_v3.xml" in said
    assert f"{XML}/MVI_1.xml; name the folder of one of them" in said


BILLION = '<?xml version="1.0"?>\n<!DOCTYPE a [<!ENTITY b "c"><!ENTITY d "&b;&b;">]>\n<sequence name="&d;"/>'


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        pytest.param(BILLION, 2, "a DTD, an entity or an external reference", id="entities"),
        pytest.param(
            '<!DOCTYPE sequence SYSTEM "file:///etc/passwd">\n<sequence/>', 1, "a DTD, an entity", id="external"
        ),
        pytest.param("<annotation>\n</annotation>", 1, "expected <sequence>, got <annotation>", id="other-kind"),
        pytest.param(SIMPLE[:-30], 0, "no valid XML", id="cut-short"),
        pytest.param("", 0, "no object in it", id="empty"),
        pytest.param("1,2,3,4", 1, "no valid XML", id="no-xml"),
        pytest.param('<?xml version="1.0" encoding="rot-99"?><sequence/>', 0, "encoding", id="encoding"),
        pytest.param(b"<sequence name='\xff'/>", 1, "no valid XML", id="latin-1"),
        pytest.param("<sequence>" + "<a>" * 100_000, 1, "elements nested deeper than 16", id="nesting"),
        pytest.param(f'<sequence name="{"x" * 3_000_000}"/>', 1, "bytes without an element", id="huge-attribute"),
        pytest.param(f"<sequence><!--{'x' * 3_000_000}--></sequence>", 1, "bytes without an element", id="comment"),
        pytest.param(annotation(name="x" * 201), 2, "name of <sequence> has more than 200 characters", id="long-name"),
        pytest.param(annotation(frame(1, target()), name="../b"), 0, "no plain name such as MVI_20011", id="name"),
        pytest.param("<sequence>\n</sequence>", 0, "no object in it", id="no-frame"),
        pytest.param(annotation(frame(1)), 0, "no object in it", id="no-target"),
        pytest.param(annotation(frame(0, target())), 5, "frames count from 1; expected 1 or more, got 0", id="frame-0"),
        pytest.param(annotation(frame("x", target())), 5, "num of <frame>: expected a number, got 'x'", id="word"),
        pytest.param(annotation(frame("1.5")), 5, "num of <frame>: expected a whole number, got 1.5", id="half"),
        pytest.param(annotation("<frame/>"), 5, "<frame> without num", id="no-num"),
        pytest.param(annotation(frame(1, "<target/>")), 6, "<target> without id", id="no-id"),
        pytest.param(
            annotation(frame(1, target(box='left="1" top="1" width="9"'))), 7, "without height", id="no-height"
        ),
        pytest.param(annotation(frame(1, '<target id="1"/>\n')), 6, "<target> without <box>", id="no-box"),
        pytest.param(
            annotation(frame(1, '<target id="1"><box left="1" top="1" width="9" height="9"/></target>')),
            6,
            "<target> without <attribute>",
            id="no-attribute",
        ),
        pytest.param(annotation(frame(1, target().replace("vehicle_", ""))), 8, "without vehicle_type", id="no-type"),
        pytest.param(annotation(frame(1, target(kind=""))), 8, "expected a class name", id="empty-type"),
        pytest.param(annotation(f"<target_list>{target()}</target_list>"), 5, "<target> outside a <frame>", id="lost"),
        pytest.param(
            annotation(frame(1, target(box='left="1" top="nan" width="9" height="9"'))), 6, "finite", id="nan-box"
        ),
        pytest.param(
            annotation(frame(1, target(box='left="1" top="1" width="0" height="9"'))),
            6,
            "expected width and height above 0, got 0 x 9",
            id="no-width",
        ),
        pytest.param(annotation(ignored=['left="1" top="1" width="inf" height="9"']), 4, "finite", id="region"),
        pytest.param(annotation(frame(1, target(overlaps=['left="1"']))), 8, "<region_overlap> without top", id="part"),
        pytest.param(
            annotation(frame(1, target(overlaps=['left="1" top="1" width="nan" height="1"']))),
            8,
            "<region_overlap>: expected width and height of 0 or more",
            id="nan-overlap",
        ),
        pytest.param(
            annotation(frame(1, target(), target())), 9, "identity 1 a second time in frame 1 (first in line 6)", id="2"
        ),
        pytest.param(annotation(frame(1, target(-1))), 0, "no object is left (left out: 1 no identity)", id="no-id-1"),
    ],
)
def test_bad_annotation_is_one_line_that_names_file_and_line(tmp_path, text, line, message):
    folder = write_detrac(tmp_path, text)
    said = refusal(FormatError, partial(open_sequences, folder))
    assert said.startswith(f"{folder}/MVI_1.xml:{line}: " if line else f"{folder}/MVI_1.xml:")
    assert message in said


def test_huge_xml_is_refused_unread(tmp_path):
    folder = write_detrac(tmp_path, "")
    os.truncate(folder / "MVI_1.xml", MAX_FILE_BYTES + 1)
    assert "MVI_1.xml: larger than 200 MB" in refusal(FormatError, partial(open_sequences, folder))


def test_too_many_objects_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("lookonce.datasets.detrac_xml.MAX_ROWS", 2)
    folder = write_detrac(tmp_path, annotation(frame(1, target(1), target(2), target(3))))
    assert "MVI_1.xml:14: more than 2 objects" in refusal(FormatError, partial(open_sequences, folder))
    folder = write_detrac(tmp_path, annotation(*(frame(n) for n in (1, 2, 3))))
    assert "MVI_1.xml:9: more than 2 frames" in refusal(FormatError, partial(open_sequences, folder))


def test_sequence_of_a_root_without_pictures_is_named(tmp_path):
    write_root(tmp_path, ["MVI_1"])
    write(tmp_path / XML / "MVI_2.xml", annotation(frame(1, target()), name="MVI_2"))
    said = refusal(VideoError, partial(open_sequences, tmp_path))
    assert "MVI_2: no such pictures for" in said
    assert f"{XML}/MVI_2.xml" in said


def test_frames_without_pictures_are_counted(tmp_path):
    folder = write_detrac(tmp_path, annotation(frame(1, target()), frame(7, target()), frame(9, target())))
    assert "no picture of frame 7 and 1 more that have truth" in refusal(VideoError, partial(open_sequences, folder))
