"""The commands as a person runs them: real processes, exit codes, one line for each error, no traceback."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cli.processes import INTERRUPTIBLE, PLAIN, assert_one_line, lookonce
from cli.running import Command
from squares import write_clip, write_darknet

HERE = Command()  # in this process, which is faster, for one more error among those that a process shows


def test_track_writes_results_that_agree(square_clip: Path, square_model: Path, tmp_path: Path) -> None:
    result = lookonce("track", square_clip, "-m", square_model, "--tracker", "paper", "-o", tmp_path / "out")
    assert result.returncode == 0, result.stderr
    mot = (tmp_path / "out" / "tracks.txt").read_text().splitlines()
    header, *frames = map(json.loads, (tmp_path / "out" / "tracks.jsonl").read_text().splitlines())
    assert len(frames) == 12
    assert len(mot) == 36 == sum(len(frame["tracks"]) for frame in frames)
    assert mot[0].startswith("1,1,0.00,24.00,8.00,8.00,")
    assert header["model"]["sha256"]
    assert header["settings"]["match_threshold"] == 0.7
    assert (tmp_path / "out" / "annotated.mp4").stat().st_size > 0
    for word in ("12 in", "decode", "detect", "associate", "write", "identities", "tracks.jsonl"):
        assert word in result.stdout


def test_two_runs_give_the_same_bytes(square_clip: Path, square_model: Path, tmp_path: Path) -> None:
    for name, threads in (("a", 1), ("b", 2)):
        lookonce("track", square_clip, "-m", square_model, "-o", tmp_path / name, "--no-video", "--threads", threads)
    for file in ("tracks.txt", "tracks.jsonl"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_results_go_to_runs_and_the_sources_name_by_default(square_clip, square_model, tmp_path) -> None:
    assert lookonce("track", square_clip, "-m", square_model, "--no-video", cwd=tmp_path).returncode == 0
    assert sorted(p.name for p in (tmp_path / "runs" / "squares").iterdir()) == ["tracks.jsonl", "tracks.txt"]


def test_earlier_results_are_kept_unless_told_otherwise(square_clip, square_model, tmp_path) -> None:
    arguments = ("track", square_clip, "-m", square_model, "-o", tmp_path, "--no-video")
    assert lookonce(*arguments, "--max-frames", 3).returncode == 0
    assert_one_line(lookonce(*arguments), 1, "tracks.txt", "--overwrite")
    assert len((tmp_path / "tracks.jsonl").read_text().splitlines()) == 4
    assert lookonce(*arguments, "--overwrite").returncode == 0
    assert len((tmp_path / "tracks.jsonl").read_text().splitlines()) == 13


def make_bad_source(kind: str, folder: Path) -> str:
    path = folder / "clip.mp4"
    if kind == "empty":
        path.write_bytes(b"")
    elif kind == "text":
        path.write_text("this is not a video\n" * 100)
    elif kind == "audio":
        import av

        with av.open(str(path), "w") as container:
            stream = container.add_stream("aac", rate=44100)
            for packet in stream.encode(None):
                container.mux(packet)
    return str(path)


@pytest.mark.parametrize("kind", ["missing", "empty", "text", "audio"])
def test_bad_sources_are_one_line(kind: str, square_model: Path, tmp_path: Path) -> None:
    source = make_bad_source(kind, tmp_path)
    assert "clip.mp4" in HERE.refusal("track", source, "-m", square_model, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("source", ["/dev/video93", "93"])
def test_a_camera_that_is_not_there_is_one_line(source: str, square_model: Path, tmp_path: Path) -> None:
    assert_one_line(lookonce("track", source, "-m", square_model, "-o", tmp_path), 1, "video93")


def test_an_unreachable_url_fails_within_ten_seconds(square_model: Path, tmp_path: Path) -> None:
    start = time.monotonic()
    result = lookonce("track", "rtsp://user:secret@127.0.0.1:9/stream", "-m", square_model, "-o", tmp_path)
    assert time.monotonic() - start < 10
    assert_one_line(result, 1, "127.0.0.1:9")
    assert "secret" not in result.stderr


def test_a_truncated_video_gives_its_good_frames_and_a_warning(square_model: Path, tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "whole.mkv", frames=60)
    cut = tmp_path / "cut.mkv"
    cut.write_bytes(clip.read_bytes()[: clip.stat().st_size // 2])
    result = lookonce("track", cut, "-m", square_model, "-o", tmp_path / "out", "--no-video")
    assert result.returncode == 0, result.stderr
    frames = len((tmp_path / "out" / "tracks.jsonl").read_text().splitlines()) - 1
    assert 0 < frames < 60
    warnings = [line for line in result.stderr.splitlines() if "warning" in line]
    assert len(warnings) == 1
    assert f"frame {frames - 1}" in warnings[0]


def edit(path: Path, old: str, new: str) -> None:
    path.write_text(path.read_text().replace(old, new, 1))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        pytest.param("filters=4", "fliters=4", "did you mean filters", id="wrong key"),
        pytest.param("[yolo]", "[route]\nlayers=9\n[yolo]", "layer 9", id="forward route"),
        pytest.param("filters=4", "filters=999999999", "filters=999999999", id="huge filter count"),
        pytest.param("[yolo]\nmask=0\nanchors=8,8\nclasses=2\nnum=1", "", "no [yolo]", id="no yolo"),
    ],
)
def test_bad_cfgs_name_file_and_remedy(old: str, new: str, message: str, tmp_path: Path) -> None:
    cfg, weights, names = write_darknet(tmp_path)
    edit(cfg, old, new)
    said = HERE.refusal("import", cfg, weights, "--names", names, "-o", tmp_path / "m.onnx")
    assert "squares.cfg" in said
    assert message in said
    assert not (tmp_path / "m.onnx").exists()


def test_weights_one_byte_short_are_refused(tmp_path: Path) -> None:
    cfg, weights, names = write_darknet(tmp_path)
    weights.write_bytes(weights.read_bytes()[:-1])
    result = lookonce("import", cfg, weights, "--names", names, "-o", tmp_path / "m.onnx")
    assert_one_line(result, 1, "squares.weights", "1 short")


def test_names_that_do_not_match_are_refused(tmp_path: Path) -> None:
    cfg, weights, names = write_darknet(tmp_path)
    names.write_text("one\n")
    said = HERE.refusal("import", cfg, weights, "--names", names, "-o", tmp_path / "m.onnx")
    for part in ("squares.names", "1 class names", "2 classes"):
        assert part in said


def test_import_says_what_it_made(tmp_path: Path) -> None:
    cfg, weights, names = write_darknet(tmp_path)
    result = lookonce("import", cfg, weights, "--names", names, "--size", "32x64", "-o", tmp_path / "m.onnx")
    assert result.returncode == 0, result.stderr
    assert "2 classes" in result.stdout
    assert "32x64" in result.stdout
    assert "lookonce" not in result.stderr
    again = lookonce("import", cfg, weights, "-o", tmp_path / "m.onnx")
    assert_one_line(again, 1, "m.onnx", "--overwrite")


def test_bad_sizes_are_refused(tmp_path: Path) -> None:
    cfg, weights, _ = write_darknet(tmp_path)
    for size, message in (("60", "multiple of 8"), ("axb", "HEIGHTxWIDTH"), ("9000", "4096")):
        said = HERE.refusal("import", cfg, weights, "--size", size, "-o", tmp_path / "m.onnx")
        assert size in said
        assert message in said


def test_foreign_and_damaged_model_files_are_refused(square_clip: Path, square_model: Path, tmp_path: Path) -> None:
    import onnx
    from onnx import TensorProto, helper

    value = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1])
    result = helper.make_tensor_value_info("y", TensorProto.FLOAT, [1])
    graph = helper.make_graph([helper.make_node("Identity", ["x"], ["y"])], "g", [value], [result])
    onnx.save(helper.make_model(graph), tmp_path / "foreign.onnx")
    model = onnx.load(square_model)
    onnx.save(model, tmp_path / "external.onnx", save_as_external_data=True, location="weights.bin", size_threshold=0)
    other = square_model.read_bytes().replace(b'"format_version": 1', b'"format_version": 9')
    (tmp_path / "version.onnx").write_bytes(other)
    # ONNX Runtime would print its own lines about this one.
    (tmp_path / "damaged.onnx").write_bytes(
        square_model.read_bytes().replace(b"NonMaxSuppression", b"NonMaxSuppressioX")
    )
    cases = {
        "foreign": "not made by lookonce",
        "external": "other files",
        "version": "version 9",
        "damaged": "cannot load it",
    }
    for name, message in cases.items():
        result = lookonce("track", square_clip, "-m", tmp_path / f"{name}.onnx", "-o", tmp_path / "out")
        assert_one_line(result, 1, f"{name}.onnx", message)


def test_an_output_folder_that_cannot_be_written_is_one_line(square_clip, square_model, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    result = lookonce("track", square_clip, "-m", square_model, "-o", tmp_path / "file" / "out")
    assert_one_line(result, 1, "file")


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(["--score", "2"], id="score out of range"),
        pytest.param(["--every", "0"], id="every zero"),
        pytest.param(["--frobnicate"], id="unknown option"),
        pytest.param(["--max-frames", "many"], id="not a number"),
    ],
)
def test_wrong_usage_is_exit_code_2(arguments: list[str], square_clip: Path, square_model: Path) -> None:
    result = lookonce("track", square_clip, "-m", square_model, *arguments)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        pytest.param(["--tracker", "sort"], "tracker 'sort'", id="tracker"),
        pytest.param(["--classes", "unicorn"], "'unicorn'", id="class"),
        pytest.param(["--match-threshold", "3"], "match_threshold", id="threshold"),
        pytest.param(["--provider", "abacus"], "'abacus'", id="provider"),
        pytest.param(["--start", "99"], "squares.mp4", id="start beyond the end"),
        pytest.param(["--fps", "5"], "--fps", id="fps of a video"),
    ],
)
def test_settings_that_cannot_work_are_one_line(arguments, message, square_clip, square_model, tmp_path) -> None:
    assert message in HERE.refusal("track", square_clip, "-m", square_model, "-o", tmp_path / "out", *arguments)


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_ctrl_c_in_mid_run_keeps_the_results_so_far(square_model: Path, tmp_path: Path) -> None:
    import av

    clip = write_clip(tmp_path / "long.mp4", frames=6000)
    out = tmp_path / "out"
    command = [*INTERRUPTIBLE, "track", str(clip), "-m", str(square_model), "--tracker", "paper", "-o", str(out)]
    with subprocess.Popen(command, env=PLAIN, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        results = out / "tracks.jsonl"
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not (results.exists() and results.stat().st_size > 20_000):
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    frames = [json.loads(line) for line in results.read_text().splitlines()][1:]
    assert 10 < len(frames) < 6000
    mot = (out / "tracks.txt").read_text()
    assert mot.endswith("\n")
    assert len(mot.splitlines()) == sum(len(frame["tracks"]) for frame in frames)
    assert "identities" in stdout
    with av.open(str(out / "annotated.mp4")) as container:
        assert sum(1 for _ in container.decode(video=0)) == len(frames)


def test_models_lists_what_is_in_a_file(square_model: Path, tmp_path: Path) -> None:
    result = lookonce("models", square_model)
    assert result.returncode == 0
    for part in ("squares.onnx", "2: red, other", "64x64", "native, 8 values", "not calibrated"):
        assert part in result.stdout
    assert_one_line(lookonce("models", tmp_path / "nothing.onnx"), 1, "nothing.onnx")
    (tmp_path / "bad.onnx").write_text("hello")
    listed = lookonce("models", tmp_path)
    assert listed.returncode == 0
    assert "skipped" in listed.stdout


@pytest.mark.parametrize("command", ["track", "import", "models"])
def test_every_command_has_help_and_examples(command: str) -> None:
    result = lookonce(command, "--help")
    assert result.returncode == 0
    assert "Examples" in result.stdout
    assert f"lookonce {command}" in result.stdout


def test_version() -> None:
    import lookonce as package

    for command in ([sys.executable, "-m", "lookonce"], [Path(sys.executable).with_name("lookonce")]):
        shown = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True, timeout=60).stdout
        assert shown == f"lookonce {package.__version__}\n"


def test_names_that_look_like_markup_are_shown_as_they_are(tmp_path: Path) -> None:
    """Rich would take "[/red]" in a class or file name for markup and fail on it."""
    cfg, weights, names = write_darknet(tmp_path)
    names.write_text("[/red]\n[bold]other\n")
    assert lookonce("import", cfg, weights, "--names", names, "-o", tmp_path / "[b].onnx").returncode == 0
    listed = lookonce("models", tmp_path / "[b].onnx")
    assert "2: [/red], [bold]other" in listed.stdout
    clip = write_clip(tmp_path / "[_x].mp4", frames=2)
    result = lookonce("track", clip, "-m", tmp_path / "[b].onnx", "-o", tmp_path / "[out]", "--no-video")
    assert result.returncode == 0, result.stderr
    assert "[_x]" in result.stdout
    assert "[out]" in result.stdout


def test_names_with_control_characters_are_refused(tmp_path: Path) -> None:
    cfg, weights, names = write_darknet(tmp_path)
    names.write_bytes(b"red\n\x1b[31mother\n")
    said = HERE.refusal("import", cfg, weights, "--names", names, "-o", tmp_path / "m.onnx")
    assert "squares.names:2" in said
    assert "control characters" in said
