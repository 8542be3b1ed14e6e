"""Descriptors of a model at the boxes of another program."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lookonce import BoxDescriber
from lookonce.errors import ModelError
from lookonce.model import Model
from lookonce.video import open_video
from squares import CELL, ROWS, SIZE, picture


def boxes(*rows: tuple[float, float, float, float]) -> np.ndarray:
    return np.array(rows, np.float32).reshape(-1, 4)


def large(scale: int = 4) -> np.ndarray:
    """Frame 2 of the squares, enlarged: the network sees it scaled down again."""
    return np.kron(picture(2), np.ones((scale, scale, 1), np.uint8))


def test_at_the_models_own_boxes_they_are_its_own(square_model: Path) -> None:
    own = Model(square_model).detect(large())
    assert len(own) == 3
    described = BoxDescriber(square_model)(large(), own.xyxy[::-1])
    np.testing.assert_allclose(described, own.descriptors[::-1], atol=1e-6)
    assert np.linalg.norm(described[0] - described[1]) > 0.5  # colours are told apart


def test_a_box_that_the_model_would_never_find_is_described_too(square_model: Path) -> None:
    """Half as large, and beside the grid."""
    left, top = 2 * CELL, ROWS["red"] * CELL
    own = boxes((left, top, left + CELL, top + CELL))
    other = boxes((left + 1, top + 2, left + 6, top + 7))
    described = BoxDescriber(square_model)(picture(2), np.vstack([own, other]))
    np.testing.assert_allclose(described[0], described[1], atol=1e-6)


def test_boxes_outside_and_tiny_ones_have_no_descriptor(square_model: Path) -> None:
    left, top = 2 * CELL, ROWS["red"] * CELL
    given = boxes(
        (left, top, left + 3.9, top + CELL),  # narrower than half a cell
        (left, top, left + 4.1, top + CELL),
        (SIZE + 1, top, SIZE + 9, top + CELL),
        (-20, -20, -1, -1),
        (left - 100, top, left - 14, top + CELL),  # 2 px of it are inside
        (-9e5, -9e5, 9e5, 9e5),
    )
    described = BoxDescriber(square_model)(picture(2) + np.uint8(1), given)
    assert np.linalg.norm(described, axis=1).round(3).tolist() == [0, 1, 0, 0, 0, 1]


def test_sizes_count_in_the_networks_input(square_model: Path) -> None:
    describe = BoxDescriber(square_model)
    assert not describe(large(), boxes((64, 32, 76, 64))).any()  # 3 px wide there
    assert describe(picture(2), boxes((16, 8, 28, 16))).any()


def test_boxes_that_are_not_finite_have_no_descriptor_and_disturb_no_other(square_model: Path) -> None:
    describe, good = BoxDescriber(square_model), (16, 8, 24, 16)
    given = [good, (np.nan, 8, 24, 16), (16, 8, np.inf, 16), (16, 8, 1e300, 16), good]  # float64, and too large
    described = describe(picture(2), given)
    np.testing.assert_array_equal(described[[0, 4]], np.repeat(describe(picture(2), boxes(good)), 2, axis=0))
    assert described[0].any()
    assert not described[1:4].any()


def test_frames_of_a_video_are_taken_as_they_are(square_model: Path, square_clip: Path) -> None:
    model, describe = Model(square_model), BoxDescriber(square_model)
    with open_video(square_clip) as video:
        for frame in video:
            own = model.detect(frame)
            np.testing.assert_allclose(describe(frame, own.xyxy), own.descriptors, atol=1e-6)


@pytest.mark.parametrize(
    ("image", "given", "message"),
    [
        pytest.param(picture(0), np.zeros((2, 6)), r"xyxy: expected \(N, 4\)", id="rows-of-six"),
        pytest.param(picture(0), np.zeros(4), r"xyxy: expected \(N, 4\)", id="one-box"),
        pytest.param(picture(0)[..., 0], np.zeros((0, 4)), r"image: expected \(H, W, 3\)", id="grey"),
    ],
)
def test_wrong_shapes_are_wrong_calls(square_model: Path, image, given, message) -> None:
    with pytest.raises(ValueError, match=message):
        BoxDescriber(square_model)(image, given)


def test_no_boxes_have_no_descriptors(square_model: Path) -> None:
    assert BoxDescriber(square_model)(picture(0), boxes()).shape == (0, 8)


def test_any_number_of_threads_gives_the_same_bytes(tiny_model) -> None:
    path = tiny_model("two-scales").path
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (90, 120, 3), dtype=np.uint8)
    corner = rng.uniform(0, 60, (20, 2))
    given = np.hstack([corner, corner + rng.uniform(10, 60, (20, 2))]).astype(np.float32)
    one, two = (BoxDescriber(path, threads=count)(image, given) for count in (1, 2))
    assert one.any(axis=1).all()
    assert one.tobytes() == two.tobytes()


def test_a_file_without_descriptors_is_refused(tiny_model) -> None:
    with pytest.raises(ModelError, match="has no descriptors; train some"):
        BoxDescriber(tiny_model("two-scales", descriptors=False).path)


def test_pytorch_is_not_needed() -> None:
    script = """
import sys
sys.modules["torch"] = sys.modules["onnxscript"] = None  # importing one of them fails
import numpy as np
from lookonce import BoxDescriber
print(BoxDescriber("street", threads=1)(np.zeros((480, 640, 3), np.uint8), np.array([[9, 9, 90, 200]], "f4")).shape)
"""
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert result.stdout == "(1, 128)\n", result.stderr
