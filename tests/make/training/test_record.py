"""The folder of a run: whose it is, what may go on in it, and what it says in the end."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, replace

import pytest

from datasets.making import refusal
from lookonce.datasets import open_sequences, open_stills
from lookonce.errors import ConfigError, OutputError
from lookonce.make.training import record
from lookonce.make.training.chunks import write_chunk
from lookonce.make.training.config import FitConfig
from lookonce.make.training.fit import FitData
from lookonce.make.training.record import Curve, fingerprint, open_run, write_record
from make.training.scenes import write_labelled, write_resting_clip, write_stills

CONFIG = FitConfig()


def identity(config: FitConfig = CONFIG, data: str = "a") -> dict[str, object]:
    return {"data": data, "features": config.for_reading(), "settings": asdict(config)}


def begin(folder, *, chunks: int = 2, checkpoint: bool = True) -> None:
    """A run that was interrupted."""
    import numpy as np

    open_run(folder, identity(), resume=False, overwrite=False)
    (folder / "features").mkdir()
    for number in range(chunks):
        write_chunk(folder / "features" / f"chunk-{number:06d}.npz", {"identity": np.arange(9)})
    if checkpoint:
        (folder / "checkpoint.safetensors").write_bytes(b"weights")


def names(folder) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


def test_an_interrupted_run_goes_on_with_resume_only(tmp_path):
    begin(tmp_path)
    before = names(tmp_path)
    message = refusal(ConfigError, lambda: open_run(tmp_path, identity(), resume=False, overwrite=False))
    assert "--resume" in message
    assert "--overwrite" in message
    open_run(tmp_path, identity(), resume=True, overwrite=False)
    assert names(tmp_path) == before


@pytest.mark.parametrize(
    "other",
    [identity(data="b"), identity(replace(CONFIG, seed=1)), identity(replace(CONFIG, steps=7))],
    ids=["data", "seed", "steps"],
)
def test_another_run_is_not_resumed(tmp_path, other):
    begin(tmp_path)
    message = refusal(ConfigError, lambda: open_run(tmp_path, other, resume=True, overwrite=False))
    assert "other data or settings" in message


@pytest.mark.parametrize("there", ["no folder", "an empty folder", "a damaged folder"])
def test_nothing_is_not_resumed(tmp_path, there):
    folder = tmp_path / "run"
    if there != "no folder":
        folder.mkdir()
    if there == "a damaged folder":
        (folder / "run.json").write_bytes(b"\xff{")
    message = refusal(ConfigError, lambda: open_run(folder, identity(), resume=True, overwrite=False))
    assert "nothing to go on with" in message


def test_a_run_that_made_nothing_is_in_nobodys_way(tmp_path):
    """One that failed early, for too little data say, left only its name."""
    open_run(tmp_path, identity(), resume=False, overwrite=False)
    open_run(tmp_path, identity(data="more"), resume=False, overwrite=False)
    open_run(tmp_path, identity(data="more"), resume=True, overwrite=False)


def test_overwrite_keeps_features_that_would_be_made_again(tmp_path):
    begin(tmp_path)
    open_run(tmp_path, identity(replace(CONFIG, learning_rate=0.1, steps=3)), resume=False, overwrite=True)
    assert names(tmp_path) == ["chunk-000000.npz", "chunk-000001.npz", "run.json"]
    open_run(tmp_path, identity(replace(CONFIG, learning_rate=0.1, steps=3)), resume=True, overwrite=False)


@pytest.mark.parametrize(
    "other", [identity(data="b"), identity(replace(CONFIG, seed=1)), identity(replace(CONFIG, kind="paper"))]
)
def test_overwrite_removes_features_of_another_run(tmp_path, other):
    begin(tmp_path)
    open_run(tmp_path, other, resume=False, overwrite=True)
    assert names(tmp_path) == ["run.json"]


def test_overwrite_removes_damaged_features(tmp_path):
    begin(tmp_path)
    path = tmp_path / "features" / "chunk-000000.npz"
    path.write_bytes(path.read_bytes()[:-5])
    open_run(tmp_path, identity(), resume=False, overwrite=True)
    assert names(tmp_path) == ["chunk-000001.npz", "run.json"]


def test_overwrite_removes_features_of_unknown_origin(tmp_path):
    begin(tmp_path)
    (tmp_path / "run.json").write_text("[]")
    open_run(tmp_path, identity(), resume=False, overwrite=True)
    assert names(tmp_path) == ["run.json"]


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    message = refusal(OutputError, lambda: open_run(tmp_path / "file" / "x", identity(), resume=False, overwrite=False))
    assert "-o" in message


def make_data(folder) -> FitData:
    return FitData(
        open_sequences(write_labelled(folder / "walk", frames=2)),
        (open_stills(write_stills(folder / "stills")),),
        (write_resting_clip(folder / "rest.mp4"),),
    )


def test_the_fingerprint_is_the_datas_and_not_the_places(tmp_path):
    first, second = make_data(tmp_path / "a"), make_data(tmp_path / "b")
    assert fingerprint(first) == fingerprint(first)
    assert fingerprint(first) == fingerprint(second)
    assert len(fingerprint(first)) == 3


def test_every_change_of_the_data_changes_the_fingerprint(tmp_path):
    first = fingerprint(make_data(tmp_path / "a"))

    def changed(name: str, change) -> None:
        folder = tmp_path / name
        data = make_data(folder)
        change(folder, data)
        data = FitData(open_sequences(folder / "walk"), (open_stills(folder / "stills"),), data.videos)
        differing = {key.split()[0] for key, digest in fingerprint(data).items() if first.get(key) != digest}
        assert differing == {name.split()[0]}

    def append(path, text: str) -> None:
        with open(path, "a") as file:
            file.write(text)

    changed("motchallenge label", lambda folder, _: append(folder / "walk/gt/gt.txt", "1,9,1,1,3,3,1,-1,-1,-1\n"))
    changed("motchallenge picture", lambda folder, _: append(folder / "walk/img1/000001.png", "more"))
    changed("stills label", lambda folder, _: append(folder / "stills/labels/0.txt", "0 0.5 0.5 0.1 0.1\n"))
    changed("stills picture", lambda folder, _: append(folder / "stills/images/0.png", "more"))
    changed("video", lambda folder, _: append(folder / "rest.mp4", "more"))


def test_data_of_one_name_are_told_apart(tmp_path):
    """Of two folders of one name only the last one was looked at."""
    one, two = write_stills(tmp_path / "a" / "set"), write_stills(tmp_path / "b" / "set", (1, 2))
    clip = write_resting_clip(tmp_path / "rest.mp4")
    found = fingerprint(FitData((), (open_stills(one), open_stills(two)), (clip, clip)))
    assert len(found) == 4


def test_a_folder_of_pictures_as_a_video_has_a_fingerprint(tmp_path):
    folder = write_labelled(tmp_path / "walk", frames=2) / "img1"
    before = fingerprint(FitData(videos=(folder,)))
    (folder / "000002.png").rename(folder / "000003.png")
    assert fingerprint(FitData(videos=(folder,))) != before


def test_data_that_cannot_be_read_are_one_line(tmp_path):
    data = make_data(tmp_path)
    os.unlink(data.stills[0].pictures[0])
    assert "0.png" in refusal(ConfigError, lambda: fingerprint(data))
    assert "gone.mp4" in refusal(ConfigError, lambda: fingerprint(FitData(videos=(tmp_path / "gone.mp4",))))


def write(folder, looks: int = 3, seconds: float = 1) -> None:
    steps, error_rate = list(range(1, looks + 1)), [0.3, 0.1, 0.2][:looks]
    write_record(
        folder,
        identity(),
        {"validation": {"error_rate": 0.1}},
        seconds,
        x=Curve("step", steps),
        loss=Curve("training loss", [1.0] * looks),
        quality=Curve("error rate", error_rate),
        best=min(1, looks - 1),
    )


@pytest.mark.parametrize("looks", [1, 3])
def test_the_record_says_what_made_the_file(tmp_path, looks):
    write(tmp_path, looks, 12.345)
    content = json.loads((tmp_path / "record.json").read_text())
    assert content["data"] == "a"
    assert content["settings"]["seed"] == 0
    assert content["seconds"] == 12.3
    assert content["validation"]["error_rate"] == 0.1
    assert {"python", "lookonce", "torch", "onnxruntime"} <= content["versions"].keys()
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")


def test_the_curves_are_the_same_bytes_each_time(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write(tmp_path / name)
    assert (tmp_path / "a" / "curves.png").read_bytes() == (tmp_path / "b" / "curves.png").read_bytes()


def test_a_package_that_goes_by_another_name_is_no_obstacle(tmp_path, monkeypatch):
    """With onnxruntime-gpu in place of onnxruntime the record failed, after all of the training."""
    monkeypatch.setattr(record, "_PACKAGES", ("lookonce", "no-such-package"))
    write(tmp_path)
    assert json.loads((tmp_path / "record.json").read_text())["versions"].keys() == {"python", "lookonce"}


def test_tensorboard_that_is_not_there_is_one_line(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "torch.utils.tensorboard", None)
    assert "pip install tensorboard" in refusal(ConfigError, record.check_tensorboard)


def test_settings_that_come_after_reading_do_not_change_features():
    later = {"steps", "identities", "rows", "learning_rate", "weight_decay", "temperature", "check_every", "patience"}
    reading = FitConfig().for_reading()
    assert not later & reading.keys()
    assert {"kind", "seed", "held_out", "score", "views", "cache_gb"} <= reading.keys()


@pytest.mark.parametrize(
    "settings", [{"kind": "other"}, {"steps": 0}, {"held_out": 0.9}, {"learning_rate": float("nan")}]
)
def test_settings_out_of_range_are_one_line(settings):
    message = refusal(ConfigError, lambda: FitConfig(**settings))
    assert next(iter(settings)) in message
