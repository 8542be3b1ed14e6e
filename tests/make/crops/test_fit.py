"""The crop network: trained on small pictures, written, and used on detections."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from typer.testing import CliRunner

from lookonce.cli.app import app
from lookonce.compare.crops import CROP_SIZE, CropDescriber, cut_out, describe_crops
from lookonce.compare.detecting import detect_sequence
from lookonce.compare.detection_store import read_detections
from lookonce.errors import LookonceError, ModelError
from lookonce.make.crops.network import CropNetwork
from lookonce.model import Model
from make.training.scenes import write_labelled, write_stills
from squares import COLOURS, picture


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory, square_model: Path) -> Path:
    """Trained for a few steps on squares of three colours."""
    folder = tmp_path_factory.mktemp("crops")
    write_labelled(folder / "seq", 12)
    write_stills(folder / "stills", range(6))
    arguments = ["fit-crops", folder / "seq", "--stills", folder / "stills", "-m", square_model]
    more = ["-o", folder / "crops.onnx", "--steps", 8, "--identities", 8, "--threads", 1]
    result = CliRunner().invoke(app, [str(one) for one in (*arguments, *more)])
    assert result.exit_code == 0, (result.output, result.exception)
    assert "crop network learnt" in result.stdout
    return folder / "crops.onnx"


def test_boxes_are_cut_out_and_stretched() -> None:
    image = np.zeros((60, 80, 3), np.uint8)
    image[10:20, 30:50] = (255, 0, 0)
    crops = cut_out(image, np.array([[30, 10, 50, 20], [-9, -9, 200, 200], [79.9, 59.9, 90, 70]], np.float32))
    assert crops.shape == (3, CROP_SIZE, CROP_SIZE, 3)
    assert (crops[0, 4:-4, 4:-4] == (255, 0, 0)).all()  # at the edge its neighbours shine in
    assert crops[1].mean() == pytest.approx(image.mean(), abs=1.5)
    assert (crops[2] == 0).all()
    assert cut_out(image, np.zeros((0, 4), np.float32)).shape == (0, CROP_SIZE, CROP_SIZE, 3)


def test_batch_of_one_equals_row_of_batch() -> None:
    torch.manual_seed(0)
    crops = CropNetwork().eval()
    planes = torch.rand(3, 3, CROP_SIZE, CROP_SIZE)
    with torch.no_grad():
        together, alone = crops(planes), crops(planes[1:2])
    assert together.shape == (3, 128)
    assert torch.allclose(together[1:2], alone, atol=1e-5)
    assert torch.allclose(together.norm(dim=1), torch.ones(3))


def test_one_colour_is_nearer_than_another(network: Path) -> None:
    describe = CropDescriber(network, 1)
    boxes = np.array([[0, 8, 8, 16], [0, 24, 8, 32], [0, 48, 8, 56]], np.float32)  # the columns of frame 0
    first = describe(picture(0), boxes)
    assert first.shape == (3, 128)
    assert np.allclose(np.linalg.norm(first, axis=1), 1, atol=1e-5)
    shifted = describe(picture(0), boxes + np.float32(0.3))
    distance = np.linalg.norm(first[:, None] - shifted[None], axis=2)
    assert (distance.argmin(axis=1) == np.arange(len(COLOURS))).all()
    assert describe(picture(0), boxes[:0]).shape[0] == 0


def test_detections_get_descriptors_from_a_score_on_and_keep_their_rows(
    network: Path, square_model: Path, square_clip: Path, tmp_path: Path
) -> None:
    model = Model(square_model, score_threshold=0.1)
    stored = detect_sequence(tmp_path / "a.npz", square_clip, model, None, lambda done, total: None)
    describer = CropDescriber(network, 1)
    limit = float(np.sort(stored.sequence.scores)[3])
    path = tmp_path / "b.npz"
    found = describe_crops(path, stored, square_clip, describer, None, limit, lambda done, total: None)
    assert np.array_equal(found.sequence.xyxy, stored.sequence.xyxy)
    assert found.describe_s > 0
    assert found.sequence.match_threshold == describer.match_threshold
    assert found.sequence.descriptors is not None
    has_look = found.sequence.descriptors.any(axis=1)
    assert np.array_equal(has_look, found.sequence.scores >= np.float32(limit))
    again = read_detections(path).sequence.descriptors
    assert again is not None
    assert np.array_equal(again, found.sequence.descriptors)


def test_other_files_are_refused(tmp_path: Path, square_model: Path, network: Path) -> None:
    for path in (square_model, tmp_path / "absent.onnx", Path(__file__)):
        with pytest.raises(ModelError):
            CropDescriber(path, 1)
    model = onnx.load(network)
    model.metadata_props[0].value = '{"format": 1, "match_threshold": 1e999}'
    onnx.save(model, tmp_path / "wild.onnx")
    with pytest.raises(ModelError, match="fit-crops"):
        CropDescriber(tmp_path / "wild.onnx", 1)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        pytest.param([], "nothing to learn from", id="nothing"),
        pytest.param(["--video", "absent.mp4"], "no such video", id="video"),
    ],
)
def test_wrong_arguments_get_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, square_model: Path, arguments: list[str], expected: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["fit-crops", *arguments, "-m", str(square_model), "-o", "a.onnx"])
    assert isinstance(result.exception, LookonceError)
    assert expected in str(result.exception)


def test_existing_file_is_not_replaced_unasked(tmp_path: Path, square_model: Path) -> None:
    (tmp_path / "a.onnx").write_text("mine")
    result = CliRunner().invoke(app, ["fit-crops", "-m", str(square_model), "-o", str(tmp_path / "a.onnx")])
    assert isinstance(result.exception, LookonceError)
    assert (tmp_path / "a.onnx").read_text() == "mine"
