"""`lookonce track --detections`: boxes from a file instead of a model."""

from __future__ import annotations

import inspect
import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from lookonce.cli import tracking
from lookonce.cli.app import app
from lookonce.errors import ConfigError, FormatError, ModelError
from lookonce.model import Model
from make.probing.labelled_squares import truth_lines

pytestmark = pytest.mark.skipif(
    "detections" not in inspect.signature(tracking.track_command).parameters, reason="track has no --detections yet"
)
FRAMES = 12  # of the clip


def track(*arguments: object) -> Result:
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, ["track", *map(str, arguments), "--no-video"])


def rows(number: int) -> list[str]:
    """Two objects in frame ``number`` (from 1), one with a low score and, after a comma, a class."""
    return [f"{number},-1,{number},24,8,8,0.9,0", f"{number},-1,{40 - number},48,9,9,0.4,1"]


def write(folder: Path, frames: range = range(1, FRAMES + 1)) -> Path:
    path = folder / "det.txt"
    path.write_text("\n".join(line for number in frames for line in rows(number)) + "\n")
    return path


def read(folder: Path) -> tuple[dict, list[dict]]:
    header, *frames = map(json.loads, (folder / "tracks.jsonl").read_text().splitlines())
    return header, frames


def boxes(frames: list[dict]) -> list[int]:
    return [len(frame["tracks"]) for frame in frames]


def test_boxes_of_a_file_are_tracked_without_a_model(square_clip: Path, tmp_path: Path) -> None:
    result = track(square_clip, "--detections", write(tmp_path), "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    header, frames = read(tmp_path / "out")
    assert boxes(frames) == [2] * FRAMES
    assert [t["xyxy"] for t in frames[2]["tracks"]] == [[3, 24, 11, 32], [37, 48, 46, 57]]
    ids = {t["id"] for frame in frames for t in frame["tracks"]} - {None}
    assert len(ids) == 2
    assert header["detections"]["file"] == "det.txt"
    assert len(header["detections"]["sha256"]) == 64
    assert "model" not in header
    assert header["settings"]["model"] is None
    assert result.stderr == ""


def test_the_annotated_video_is_made_too(square_clip: Path, tmp_path: Path) -> None:
    command = ["track", str(square_clip), "--detections", str(write(tmp_path)), "-o", str(tmp_path / "out")]
    assert CliRunner().invoke(app, command).exit_code == 0
    assert (tmp_path / "out" / "annotated.mp4").stat().st_size > 0


def test_two_runs_give_the_same_bytes_and_results_can_be_tracked_again(square_clip: Path, tmp_path: Path) -> None:
    path = write(tmp_path)
    for name in ("a", "b"):
        assert track(square_clip, "--detections", path, "-o", tmp_path / name).exit_code == 0
    for file in ("tracks.txt", "tracks.jsonl"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    again = track(square_clip, "--detections", tmp_path / "a" / "tracks.jsonl", "-o", tmp_path / "c")
    assert again.exit_code == 0, again.output
    assert boxes(read(tmp_path / "c")[1]) == [2] * FRAMES


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        pytest.param(["--score", "0.5"], [1] * FRAMES, id="score"),
        pytest.param(["--classes", "1"], [1] * FRAMES, id="class"),
        pytest.param(["--every", "5"], [2, 2, 2], id="every"),
        pytest.param(["--start", "0.95"], [2, 2], id="start"),
        pytest.param(["--end", "0.25"], [2, 2, 2], id="end"),
        pytest.param(["--max-frames", "4"], [2] * 4, id="max-frames"),
    ],
)
def test_the_other_options_still_work(square_clip: Path, tmp_path: Path, options, expected) -> None:
    result = track(square_clip, "--detections", write(tmp_path), "-o", tmp_path / "out", *options)
    assert result.exit_code == 0, result.output
    assert boxes(read(tmp_path / "out")[1]) == expected


def test_frames_keep_their_numbers_when_some_are_skipped(square_clip: Path, tmp_path: Path) -> None:
    track(square_clip, "--detections", write(tmp_path), "-o", tmp_path / "out", "--every", 5)
    _, frames = read(tmp_path / "out")
    assert [(frame["frame"], frame["tracks"][0]["xyxy"][0]) for frame in frames] == [(0, 1), (5, 6), (10, 11)]


@pytest.mark.parametrize(
    ("frames", "options", "message"),
    [
        pytest.param(range(1, 8), [], "ends with frame 7; none are found in the frames up to 12", id="file shorter"),
        pytest.param(range(1, 31), [], "goes on to frame 30, but the video ends with frame 12", id="video shorter"),
        pytest.param(range(1, 31), ["--max-frames", "5"], "", id="a part of the video"),
        pytest.param(range(1, 1), [], "holds no detections", id="empty"),
    ],
)
def test_other_ends_are_said_once(square_clip: Path, tmp_path: Path, caplog, frames, options, message) -> None:
    path = write(tmp_path, frames)
    result = track(square_clip, "--detections", path, "-o", tmp_path / "out", *options)
    assert result.exit_code == 0, result.output
    said = [record.getMessage() for record in caplog.records if "det.txt" in record.getMessage()]
    assert len(said) == bool(message)
    assert message in "".join(said)


@pytest.mark.parametrize(("box", "is_said"), [("1,1,8,8", False), ("90,90,120,120", True)])
def test_boxes_in_another_layout_are_said(square_clip: Path, tmp_path: Path, caplog, box, is_said) -> None:
    """Corners taken for left, top, width and height reach beyond the picture."""
    path = tmp_path / "det.txt"
    path.write_text("".join(f"{number},-1,{box},0.9\n" for number in range(1, 13)))
    assert track(square_clip, "--detections", path, "-o", tmp_path / "out").exit_code == 0
    said = "\n".join(record.getMessage() for record in caplog.records)
    assert ("100 % of the boxes reach far beyond the picture" in said) == is_said


def test_bad_rows_and_foreign_scores_are_said(square_clip: Path, tmp_path: Path, caplog) -> None:
    path = tmp_path / "det.txt"
    path.write_text("1,-1,1,1,8,8,34.2\n1,-1,1,1,-8,8,5\n12,-1,1,1,nan,8,-5.8\n12,-1,1,1,8,8,-5.8\n")
    assert track(square_clip, "--detections", path, "-o", tmp_path / "out").exit_code == 0
    said = "\n".join(record.getMessage() for record in caplog.records)
    assert "rows left out: 1 of zero or negative size, 1 with a number that is not finite" in said
    assert "scores from -5.8 to 34.2 are taken as 0 to 1" in said


@pytest.mark.parametrize(
    ("text", "options", "error", "message"),
    [
        pytest.param("0,-1,1,1,8,8\n", [], FormatError, r"det\.txt:1: frame: frames count from 1", id="from zero"),
        pytest.param("1,-1,1,1,8,8\n", ["--tracker", "paper"], ConfigError, "no descriptors.*default", id="paper"),
        pytest.param("1,-1,1,1,8,8\n", ["--match-threshold", "1"], ConfigError, "leave it out", id="threshold"),
        pytest.param("1,-1,1,1,8,8\n", ["--classes", "car"], ConfigError, "it has object", id="class"),
    ],
)
def test_what_cannot_work_is_one_line(square_clip: Path, tmp_path: Path, text, options, error, message) -> None:
    path = tmp_path / "det.txt"
    path.write_text(text)
    result = track(square_clip, "--detections", path, "-o", tmp_path / "out", *options)
    assert isinstance(result.exception, error)
    with pytest.raises(error, match=message):
        raise result.exception
    assert not (tmp_path / "out").exists()


SQUARES = truth_lines(FRAMES)  # of the clip: three squares, each in its own row, a cell further each frame


@pytest.fixture
def square_boxes(tmp_path: Path) -> Path:
    """The squares in the detector's place, in another order in every frame; in frame 3 also a box outside."""
    lines = []
    for number in range(1, FRAMES + 1):
        boxes = [line.split(",")[2:6] for line in SQUARES if line.startswith(f"{number},")]
        lines += [
            f"{number},-1,{','.join(box)},0.{4 + row},{7 + row}" for row, box in enumerate(boxes[:: (-1) ** number])
        ]
    path = tmp_path / "boxes.txt"
    path.write_text("\n".join([*lines, "3,-1,80,24,8,8,0.9,9"]) + "\n")
    return path


def test_a_model_beside_the_file_describes_its_boxes(square_clip: Path, square_model: Path, square_boxes, tmp_path):
    """No square overlaps itself in the frame before: only appearance can tell which is which."""
    command = (square_clip, "--detections", square_boxes, "-m", square_model, "--tracker", "paper")
    result = track(*command, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "squares.onnx at the boxes of boxes.txt" in result.stdout
    header, frames = read(tmp_path / "out")
    assert boxes(frames) == [3, 3, 4, *[3] * (FRAMES - 3)]
    rows_of: dict[int, set[float]] = {}
    for frame in frames:
        for t in frame["tracks"]:
            rows_of.setdefault(t["id"], set()).add(t["xyxy"][1] if t["xyxy"][0] < 64 else "outside")
    rows_of = {identity: rows for identity, rows in rows_of.items() if rows != {"outside"}}
    assert sorted(map(sorted, rows_of.values())) == [[8], [24], [48]]
    assert {t["name"] for t in frames[0]["tracks"]} == {"7", "8", "9"}  # the file's classes, not the model's
    assert header["detections"]["file"] == "boxes.txt"
    assert header["model"]["file"] == "squares.onnx"
    assert len(header["model"]["sha256"]) == 64
    assert header["model"]["descriptor"]["kind"] == "native"
    assert header["settings"]["model"] == str(square_model)


def test_boxes_and_scores_are_the_same_with_and_without_descriptors(
    square_clip: Path, square_model: Path, square_boxes, tmp_path
) -> None:
    def found(*more: object) -> list[list[tuple]]:
        out = tmp_path / f"out{len(more)}"
        assert track(square_clip, "--detections", square_boxes, "-o", out, *more).exit_code == 0
        return [[(t["xyxy"], t["score"]) for t in frame["tracks"]] for frame in read(out)[1]]

    assert found("-m", square_model) == found()


def test_any_number_of_threads_gives_the_same_bytes(square_clip: Path, square_boxes, tmp_path: Path) -> None:
    for threads in (1, 2):
        options = ("-m", "street", "--explain", "--threads", threads, "-o", tmp_path / str(threads))
        assert track(square_clip, "--detections", square_boxes, *options).exit_code == 0
    for file in ("tracks.txt", "tracks.jsonl", "explain.jsonl"):
        assert (tmp_path / "1" / file).read_bytes() == (tmp_path / "2" / file).read_bytes()
    story = (tmp_path / "1" / "explain.jsonl").read_text()
    assert '"appearance"' in story


@pytest.mark.parametrize("given", [None, 0.9], ids=["the models", "given"])
def test_the_match_threshold_is_the_models_unless_given(square_clip, square_boxes, tmp_path, given) -> None:
    options = () if given is None else ("--match-threshold", given)
    command = (square_clip, "--detections", square_boxes, "-m", "street", "--max-frames", 2, "-o", tmp_path / "out")
    assert track(*command, *options).exit_code == 0
    info = Model("street").metadata.descriptor
    assert info is not None
    assert read(tmp_path / "out")[0]["settings"]["match_threshold"] == (given or info.match_threshold)


def test_missing_packages_are_named_in_one_line(square_clip, square_boxes, tmp_path, monkeypatch) -> None:
    monkeypatch.delitem(sys.modules, "lookonce.make.export.reopen", raising=False)
    monkeypatch.setitem(sys.modules, "onnx_ir", None)
    result = track(square_clip, "--detections", square_boxes, "-m", "street", "-o", tmp_path / "out")
    assert isinstance(result.exception, ConfigError)
    assert "need the extra 'describe' (onnx_ir is missing); pip install 'lookonce[describe]'" in str(result.exception)
    assert track(square_clip, "--detections", square_boxes, "-o", tmp_path / "out").exit_code == 0


def test_a_model_without_descriptors_is_one_line(square_clip, square_boxes, tiny_model, tmp_path) -> None:
    path = tiny_model("two-scales", descriptors=False).path
    result = track(square_clip, "--detections", square_boxes, "-m", path, "-o", tmp_path / "out")
    assert isinstance(result.exception, ModelError)
    assert "has no descriptors; train some with 'lookonce fit'" in str(result.exception)
    assert not (tmp_path / "out").exists()
