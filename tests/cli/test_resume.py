"""`lookonce track --resume`: after Ctrl-C or a kill the results are those of a run that never stopped."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from cli.processes import INTERRUPTIBLE, PLAIN, assert_one_line, lookonce
from cli.running import Command
from lookonce.output import CHECKPOINT_FILE, read_checkpoint
from lookonce.video import VideoWriter
from make.probing.labelled_squares import truth_lines
from squares import write_clip

FRAMES = 1000
ENOUGH = 30_000  # bytes of tracks.jsonl, of some 400,000
FILES = ("tracks.txt", "tracks.jsonl", "explain.jsonl")


@pytest.fixture(scope="module")
def long_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clip(tmp_path_factory.mktemp("long") / "long.mp4", frames=FRAMES)


@pytest.fixture(scope="module")
def unbroken(long_clip: Path, square_model: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a run that never stops leaves."""
    out = tmp_path_factory.mktemp("unbroken")
    result = lookonce(*_command(long_clip, square_model, out))
    assert result.returncode == 0, result.stderr
    assert not (out / CHECKPOINT_FILE).exists()
    assert not list(out.glob("checkpoint*"))
    return out


def _command(clip: Path, model: Path, out: Path, *more: str) -> list[str]:
    return ["track", str(clip), "-m", str(model), "--no-video", "--explain", "-o", str(out), *more]


def _stop(command: list[str], out: Path, how: signal.Signals, is_ready) -> None:
    with subprocess.Popen([*INTERRUPTIBLE, *command], env=PLAIN, stdout=-1, stderr=-1) as process:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not is_ready():
            time.sleep(0.01)
        process.send_signal(how)
        process.communicate(timeout=60)
    assert process.returncode not in (0, 1)


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_after_ctrl_c_the_rest_gives_the_same_bytes(long_clip, square_model, unbroken, tmp_path) -> None:
    results = tmp_path / "tracks.jsonl"
    command = _command(long_clip, square_model, tmp_path)
    _stop(command, tmp_path, signal.SIGINT, lambda: results.exists() and results.stat().st_size > ENOUGH)
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    assert kept.frame == json.loads(results.read_text().splitlines()[-1])["frame"] < FRAMES - 1
    assert "--resume goes on, --overwrite begins again" in Command().refusal(*command)
    without = [one for one in command if one != "--explain"]
    assert "begun with --explain" in Command().refusal(*without, "--resume")
    again = lookonce(*command, "--resume")
    assert again.returncode == 0, again.stderr
    assert f"going on after frame {kept.frame + 1}" in again.stdout
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (unbroken / name).read_bytes(), name
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)
    assert "complete" in Command().refusal(*command, "--resume")


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGKILL")
def test_after_a_kill_it_goes_on_from_the_last_checkpoint(long_clip, square_model, unbroken, tmp_path) -> None:
    script = (
        "import lookonce.output.checkpoint as checkpoint; checkpoint._EVERY_S = 0.05;"
        "from lookonce.cli.app import main; main()"
    )
    command = [sys.executable, "-c", script, *_command(long_clip, square_model, tmp_path)]
    results = tmp_path / "tracks.jsonl"
    with subprocess.Popen(command, env=PLAIN, stdout=-1, stderr=-1) as process:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not (results.exists() and results.stat().st_size > ENOUGH):
            time.sleep(0.01)
        process.kill()
        process.communicate(timeout=60)
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    with results.open("ab") as file:
        file.write(b'{"frame": half a line')  # what a crash may leave
    assert lookonce(*_command(long_clip, square_model, tmp_path), "--resume").returncode == 0
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (unbroken / name).read_bytes(), name


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGKILL")
def test_after_a_kill_before_the_first_checkpoint_it_begins_again(long_clip, square_model, unbroken, tmp_path) -> None:
    results, command = tmp_path / "tracks.jsonl", _command(long_clip, square_model, tmp_path)
    _stop(command, tmp_path, signal.SIGKILL, lambda: results.exists() and results.stat().st_size > 0)
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    assert kept.frame == -1
    assert "--resume goes on, --overwrite begins again" in Command().refusal(*command)
    assert lookonce(*command, "--resume").returncode == 0
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (unbroken / name).read_bytes(), name
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_boxes_of_others_with_descriptors_are_gone_on_with_to_the_same_bytes(long_clip, square_model, tmp_path) -> None:
    detections = tmp_path / "det.txt"
    detections.write_text("".join(f"{line}\n" for line in truth_lines(FRAMES)))

    def command(out: Path) -> list[str]:
        return [*_command(long_clip, square_model, out), "--detections", str(detections)]

    unbroken, stopped = tmp_path / "unbroken", tmp_path / "stopped"
    assert lookonce(*command(unbroken)).returncode == 0
    results = stopped / "tracks.jsonl"
    _stop(command(stopped), stopped, signal.SIGINT, lambda: results.exists() and results.stat().st_size > ENOUGH)
    kept = read_checkpoint(stopped)
    assert kept is not None
    assert 0 < kept.frame < FRAMES - 1
    without = [one for one in command(stopped) if one not in ("-m", str(square_model))]
    assert "begun with other" in Command().refusal(*without, "--resume")
    again = lookonce(*command(stopped), "--resume")
    assert again.returncode == 0, again.stderr
    for name in FILES:
        assert (stopped / name).read_bytes() == (unbroken / name).read_bytes(), name


SEEN = (180, 320)  # what the moving camera sees of a wall, height and width
WALL = (300, 480)
PAN_FRAMES = 500


def _corner(index: int) -> tuple[int, int]:
    """Top and left of what a camera in an unsteady hand sees."""
    return round(60 + 45 * math.sin(index / 7) + 8 * math.sin(index)), round(80 + 75 * math.sin(index / 11))


@pytest.fixture(scope="module")
def pan(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A clip of a speckled wall, and boxes of six things that hang on it."""
    folder, rng = tmp_path_factory.mktemp("pan"), np.random.default_rng(0)
    wall = np.kron(rng.integers(30, 226, (WALL[0] // 6, WALL[1] // 6), dtype=np.uint8), np.ones((6, 6), np.uint8))
    things = rng.uniform((60, 80), (WALL[1] - 80, WALL[0] - 80), (6, 2))
    lines = []
    with VideoWriter(folder / "pan.mp4", 25) as writer:
        for index in range(PAN_FRAMES):
            top, left = _corner(index)
            writer.write(np.stack([wall[top : top + SEEN[0], left : left + SEEN[1]]] * 3, axis=2), index / 25)
            for x, y in things - (left, top) + rng.normal(0, 1, (6, 2)):
                lines.append(f"{index + 1},-1,{x:.2f},{y:.2f},16,24,{rng.uniform(0.3, 0.9):.3f},-1,-1,-1")
    (folder / "det.txt").write_text("\n".join(lines) + "\n")
    return folder / "pan.mp4", folder / "det.txt"


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_a_moving_camera_is_gone_on_with_to_the_same_bytes(pan, tmp_path) -> None:
    """What the camera had seen was not kept: in the first frame after a stop it counted as still."""

    def command(out: Path) -> list[str]:
        return ["track", str(pan[0]), "--detections", str(pan[1]), "--no-video", "--explain", "-o", str(out)]

    unbroken, stopped = tmp_path / "unbroken", tmp_path / "stopped"
    assert lookonce(*command(unbroken)).returncode == 0
    results, enough = stopped / "tracks.jsonl", 0.3 * (unbroken / "tracks.jsonl").stat().st_size
    _stop(command(stopped), stopped, signal.SIGINT, lambda: results.exists() and results.stat().st_size > enough)
    kept = read_checkpoint(stopped)
    assert kept is not None
    assert 0 < kept.frame < PAN_FRAMES - 1
    assert sorted(kept.states) == ["camera", "tracker"]
    again = lookonce(*command(stopped), "--resume")
    assert again.returncode == 0, again.stderr
    for name in FILES:
        assert (stopped / name).read_bytes() == (unbroken / name).read_bytes(), name
    assert sorted(path.name for path in stopped.iterdir()) == sorted(FILES)


def _stopped(long_clip: Path, square_model: Path, out: Path) -> list[str]:
    command = _command(long_clip, square_model, out)
    results = out / "tracks.jsonl"
    _stop(command, out, signal.SIGINT, lambda: results.exists() and results.stat().st_size > ENOUGH)
    return command


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_what_cannot_be_gone_on_with_is_one_line_and_nothing_is_lost(long_clip, square_model, tmp_path) -> None:
    command = _stopped(long_clip, square_model, tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def refusal(*more: str) -> str:
        return Command().refusal(*command, "--resume", *more)

    assert_one_line(lookonce(*command, "--resume", "--score", "0.3"), 1, "other settings (score)")
    (tmp_path / CHECKPOINT_FILE).write_text("{}")
    assert CHECKPOINT_FILE in refusal()
    record = json.loads(before[CHECKPOINT_FILE])
    (tmp_path / CHECKPOINT_FILE).write_text(json.dumps(record | {"states": {"tracker": "../elsewhere.state"}}))
    assert "outside the folder" in refusal()
    (tmp_path / CHECKPOINT_FILE).write_text(json.dumps(record | {"format_version": 1}))
    said = refusal()
    assert "version 1" in said
    assert "--overwrite" in said
    (tmp_path / CHECKPOINT_FILE).write_bytes(before[CHECKPOINT_FILE])
    for state in record["states"].values():
        (tmp_path / state).write_bytes(b"cut")
        assert state in refusal()
        (tmp_path / state).write_bytes(before[state])
    (tmp_path / "tracks.txt").write_bytes(b"")
    assert "tracks.txt" in refusal()
    (tmp_path / "tracks.txt").write_bytes(before["tracks.txt"])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    (tmp_path / CHECKPOINT_FILE).write_text("{}")
    assert lookonce(*command, "--overwrite").returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)


def test_resume_without_an_earlier_run_starts(square_clip: Path, square_model: Path, tmp_path: Path) -> None:
    assert lookonce(*_command(square_clip, square_model, tmp_path / "out"), "--resume").returncode == 0
    assert lookonce(*_command(square_clip, square_model, tmp_path), "--resume", "--overwrite").returncode == 2


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_the_rest_of_the_video_goes_to_a_second_file(long_clip, square_model, tmp_path) -> None:
    import av

    command = [one for one in _command(long_clip, square_model, tmp_path) if one not in ("--no-video", "--explain")]
    results = tmp_path / "tracks.jsonl"
    _stop(command, tmp_path, signal.SIGINT, lambda: results.exists() and results.stat().st_size > ENOUGH)
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    assert lookonce(*command, "--resume").returncode == 0
    frames = []
    for name in ("annotated.mp4", f"annotated-from-{kept.frame + 1}.mp4"):
        with av.open(str(tmp_path / name)) as container:
            frames.append(sum(1 for _ in container.decode(video=0)))
    assert frames == [kept.frame + 1, FRAMES - 1 - kept.frame]
