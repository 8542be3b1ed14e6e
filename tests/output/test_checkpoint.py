"""Where a run stands: what is kept, what is removed, and what is no checkpoint."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lookonce.errors import FormatError
from lookonce.output import CHECKPOINT_FILE, CheckpointSink, read_checkpoint
from output.scenes import make_frame, make_tracks

RECORD = {
    "format": "lookonce-checkpoint",
    "format_version": 2,
    "frame": 3,
    "sizes": {"tracks.txt": 10},
    "states": {"tracker": "checkpoint-3.tracker"},
}


def sink(folder: Path) -> CheckpointSink:
    states = {name: lambda path, name=name: path.write_text(name) and None for name in ("tracker", "camera")}
    return CheckpointSink(folder, states, lambda: {"tracks.txt": 10})


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_only_the_newest_states_are_kept_and_none_in_the_end(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("lookonce.output.checkpoint._EVERY_S", 0.0)
    (tmp_path / "camera-2.state").write_text("mine")
    (tmp_path / "checkpoint-9.camera.77.part").write_text("half, left by a kill")
    checkpoint = sink(tmp_path)
    for index in range(3):
        checkpoint.write(make_frame(index), make_tracks())
    checkpoint.close()
    assert names(tmp_path) == ["camera-2.state", "checkpoint-2.camera", "checkpoint-2.tracker", CHECKPOINT_FILE]
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    assert (kept.frame, kept.sizes) == (2, {"tracks.txt": 10})
    assert {name: path.read_text() for name, path in kept.states.items()} == {"tracker": "tracker", "camera": "camera"}
    checkpoint.finish()
    assert names(tmp_path) == ["camera-2.state"]


def test_a_run_that_has_begun_is_not_complete(tmp_path: Path) -> None:
    CheckpointSink.begin(tmp_path)
    assert names(tmp_path) == [CHECKPOINT_FILE]
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    assert (kept.frame, kept.sizes, kept.states) == (-1, {}, {})
    sink(tmp_path).finish()
    assert read_checkpoint(tmp_path) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param({"format": "other"}, "another kind", id="format"),
        pytest.param({"format_version": 1}, "version 1, expected 2", id="version"),
        pytest.param({"frame": -1}, "range", id="frame"),
        pytest.param({"frame": -1, "states": {}}, "range", id="begun with results"),
        pytest.param({"sizes": {"../x": 1}}, "outside", id="result elsewhere"),
        pytest.param({"states": {"tracker": "/etc/x"}}, "outside", id="state elsewhere"),
        pytest.param({"states": {"tracker": 5}}, "no checkpoint", id="no name"),
        pytest.param({"states": {"camera": "checkpoint-3.camera"}}, "tracker's state", id="no tracker"),
        pytest.param({"states": []}, "no checkpoint", id="no states"),
    ],
)
def test_what_is_no_checkpoint_is_one_line_with_the_remedy(tmp_path: Path, change, message) -> None:
    (tmp_path / CHECKPOINT_FILE).write_text(json.dumps(RECORD))
    assert read_checkpoint(tmp_path) is not None
    (tmp_path / CHECKPOINT_FILE).write_text(json.dumps(RECORD | change))
    with pytest.raises(FormatError, match=message) as caught:
        read_checkpoint(tmp_path)
    assert "--overwrite" in str(caught.value)
    assert "\n" not in str(caught.value)
