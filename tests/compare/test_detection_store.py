"""Detections on disk; files that others may have made are checked before they are used."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from compare.moving import lane, make_sequence
from lookonce.compare.detection_store import StoredDetections, read_detections, write_detections
from lookonce.errors import FormatError, OutputError


@pytest.fixture
def stored():
    return StoredDetections(make_sequence([lane(0), lane(90)])[0], 1.5, 0.5)


def rewrite(path, name, content):
    """Replaces one member of the archive, or adds it."""
    with zipfile.ZipFile(path) as archive:
        members = {one: archive.read(one) for one in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for one, data in {**members, name: content}.items():
            archive.writestr(one, data)


def npy(array, **options):
    data = io.BytesIO()
    np.save(data, array, **options)
    return data.getvalue()


@pytest.mark.parametrize("size", [(64, 48), None])
@pytest.mark.parametrize("has_descriptors", [True, False])
def test_what_was_written_is_read(tmp_path, has_descriptors, size):
    sequence, _ = make_sequence([lane(0), lane(90, hidden=(2, 3))])
    if not has_descriptors:
        sequence = type(sequence)(*(getattr(sequence, name) for name in list(sequence.__slots__)[:6]))
    camera = np.array([[1.0, 0, 5], [0, 1, 0]])
    sequence = replace(sequence, size=size, cameras={1: {}, 2: {4: camera, 6: 2 * camera}})
    write_detections(tmp_path / "new" / "a.npz", StoredDetections(sequence, 1.5, 0.5, 0.1))
    back = read_detections(tmp_path / "new" / "a.npz")
    assert (back.detect_s, back.describe_s, back.camera_score, back.sequence.size) == (1.5, 0.5, 0.1, size)
    assert back.sequence.cameras[1] == {}
    assert {frame: one.tolist() for frame, one in back.sequence.cameras[2].items()} == {
        4: camera.tolist(),
        6: (2 * camera).tolist(),
    }
    for name in ("frames", "times", "starts", "xyxy", "scores", "labels"):
        assert np.array_equal(getattr(back.sequence, name), getattr(sequence, name))
    assert (back.sequence.descriptors is not None) == has_descriptors
    assert back.sequence.match_threshold == sequence.match_threshold
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.npz"]


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        pytest.param("evil.npy", npy(np.zeros(1)), "other arrays", id="unknown"),
        pytest.param("scores.npy", npy(np.array([{}]), allow_pickle=True), "scores", id="pickle"),
        pytest.param("scores.npy", npy(np.zeros(24)), "float32", id="dtype"),
        pytest.param("scores.npy", npy(np.zeros(3, np.float32)), "scores", id="rows"),
        pytest.param("scores.npy", b"\x93NUMPY\x01\x00\x05\x00{}", "scores", id="header"),
        pytest.param(
            "scores.npy",
            npy(np.zeros(1, np.float32)).replace(b"(1,), }", b"(9999999999,), }")[:-4],
            "scores",
            id="promises-more",
        ),
        pytest.param("version.npy", npy(np.array(7)), "version", id="version"),
        pytest.param("size.npy", npy(np.zeros(3, np.int64)), "another shape", id="size"),
        pytest.param("size.npy", npy(np.array([64, -1])), "size", id="negative-size"),
        pytest.param("camera_rows.npy", npy(np.zeros((1, 2), np.int64)), "another shape", id="camera-rows"),
        pytest.param("camera_steps.npy", npy(np.zeros((1, 2), np.int64)), "another shape", id="camera-steps"),
        pytest.param("camera_score.npy", npy(np.zeros(2)), "another shape", id="camera-score"),
        pytest.param("camera_maps.npy", npy(np.array(1.0)), "cannot be", id="camera-maps"),
        pytest.param("xyxy.npy", npy(np.array(1.0, np.float32)), "cannot be", id="no-rows"),
        pytest.param("camera_steps.npy", npy(np.array([-1])), "not", id="negative-step"),
        pytest.param("camera_steps.npy", npy(np.arange(1, 2000)), "more than", id="many-steps"),
        pytest.param("starts.npy", npy(np.full(13, 99)), "starts", id="starts"),
    ],
)
def test_other_contents_are_refused(tmp_path, stored, name, content, expected):
    path = tmp_path / "a.npz"
    write_detections(path, stored)
    rewrite(path, name, content)
    with pytest.raises(FormatError, match=expected) as caught:
        read_detections(path)
    assert "remove the file" in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"text"])
def test_files_of_other_kinds_are_refused(tmp_path, content):
    path = tmp_path / "a.npz"
    path.write_bytes(content)
    with pytest.raises(FormatError, match="damaged, or no such file"):
        read_detections(path)


def test_truncated_file_is_refused(tmp_path, stored):
    path = tmp_path / "a.npz"
    write_detections(path, stored)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(FormatError):
        read_detections(path)


def test_folder_that_cannot_be_made_is_named(tmp_path, stored):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="choose another place"):
        write_detections(tmp_path / "file" / "a.npz", stored)
