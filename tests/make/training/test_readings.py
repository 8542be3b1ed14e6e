"""Features on disk: made once, the same whoever makes them, and not believed when they come back."""

from __future__ import annotations

import errno
import os
import threading
import time
import zipfile

import numpy as np
import pytest

from datasets.making import refusal
from lookonce.datasets import open_sequences, open_stills
from lookonce.errors import ConfigError, OutputError
from lookonce.make.descriptors.compact import CompactKind
from lookonce.make.export.reopen import RowReader
from lookonce.make.training import readings as module
from lookonce.make.training.chunks import is_whole_chunk, read_chunks, write_chunk
from lookonce.make.training.readings import read_features
from lookonce.make.training.sources import SequenceSource, TrackedBoxes
from lookonce.make.training.stills import StillsSource
from lookonce.model import describe_model
from make.training.scenes import write_labelled, write_stills

UNLIMITED = 10**12


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    tracked = TrackedBoxes.of_sequence(open_sequences(write_labelled(folder / "walk"))[0])
    held = np.array([False, True, False])
    stills = open_stills(write_stills(folder / "stills"))
    return [
        SequenceSource(tracked, (64, 64), frames=100, held_out=held, seed=[1]),
        StillsSource(stills, (64, 64), views=2, collages=2, variants=0, held_out=0.2, seed=[2]),
    ]


class CountingReader:
    """A reader that counts its calls, and how many run at once."""

    def __init__(self, model) -> None:
        self._reader = RowReader(model, CompactKind.of(describe_model(model)).write_reading)
        self.metadata = self._reader.metadata
        self.opened = self.calls = self.most = self._running = 0
        self._lock = threading.Lock()

    def open(self) -> CountingReader:
        self.opened += 1
        return self

    def __call__(self, canvases, rows):
        with self._lock:
            self.calls += 1
            self._running += 1
            self.most = max(self.most, self._running)
        time.sleep(0.001)
        result = self._reader(canvases, rows)
        with self._lock:
            self._running -= 1
        return result


@pytest.fixture
def reader(square_model):
    return CountingReader(square_model)


@pytest.fixture(autouse=True)
def _small_chunks(monkeypatch):
    monkeypatch.setattr(module, "CHUNK_TASKS", 5)


def read(sources, reader, folder, *, workers=1, limit_bytes=UNLIMITED, report=lambda done, total: None):
    return read_features(sources, reader.open, folder, workers=workers, limit_bytes=limit_bytes, report=report)


def as_bytes(readings) -> dict[str, bytes]:
    columns = {name: getattr(readings, name) for name in ("identity", "source", "frame", "height_px", "lifetime")}
    return {name: array.tobytes() for name, array in (columns | dict(readings.values)).items()}


def chunk_bytes(folder) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_readings_say_what_was_seen_where(sources, reader, tmp_path):
    found = read(sources, reader, tmp_path)
    assert len(found) == len(found.values["points"]) == len(found.identity)
    assert found.values["points"].dtype == np.float16
    assert found.names == ("walk", "stills")
    assert set(found.identity[found.source == 0].tolist()) <= {0, 1, 2}
    assert set(found.identity[found.source == 1].tolist()) <= set(range(3, 12))
    assert found.held_out.shape == found.scene.shape == (12,)
    assert found.held_out[:3].tolist() == [False, True, False]
    assert found.scene[:3].tolist() == [0, 0, 0]
    assert found.scene[3:].min() == 1
    assert (found.height_px > 0).all()


def test_the_number_of_workers_does_not_change_a_byte(sources, square_model, tmp_path):
    folders = {}
    for workers in (1, 3):
        reader = CountingReader(square_model)
        folders[workers] = as_bytes(read(sources, reader, tmp_path / str(workers), workers=workers))
        assert reader.most <= workers
        assert reader.opened == 1
    assert folders[1] == folders[3]
    assert chunk_bytes(tmp_path / "1") == chunk_bytes(tmp_path / "3")


def test_chunks_that_are_there_are_not_made_again(sources, reader, tmp_path):
    first = read(sources, reader, tmp_path)
    calls = reader.calls
    again = read(sources, reader, tmp_path)
    assert (reader.calls, reader.opened) == (calls, 1)
    assert as_bytes(again) == as_bytes(first)
    (tmp_path / "chunk-000002.npz").unlink()
    third = read(sources, reader, tmp_path)
    assert calls < reader.calls <= calls + module.CHUNK_TASKS
    assert as_bytes(third) == as_bytes(first)


def test_an_interrupted_reading_goes_on_with_the_next_chunk(sources, reader, tmp_path):
    def interrupt(done, total):
        if done >= 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        read(sources, reader, tmp_path / "a", report=interrupt)
    before = reader.calls
    assert len(list((tmp_path / "a").iterdir())) == 2
    resumed = read(sources, reader, tmp_path / "a")
    made = reader.calls - before
    whole = read(sources, reader, tmp_path / "b")
    assert as_bytes(resumed) == as_bytes(whole)
    assert made + before == reader.calls - made - before


def test_an_interruption_in_the_middle_of_a_chunk_stops_at_once(sources, reader, tmp_path, monkeypatch):
    """Ctrl-C has to wait for the pictures at work, not for all of a chunk."""
    monkeypatch.setattr(module, "CHUNK_TASKS", 1000)
    inner = reader.__class__.__call__

    def interrupted(self, canvases, rows):
        if self.calls == 3:
            raise KeyboardInterrupt
        return inner(self, canvases, rows)

    monkeypatch.setattr(CountingReader, "__call__", interrupted)
    with pytest.raises(KeyboardInterrupt):
        read(sources, reader, tmp_path, workers=2)
    assert reader.calls <= 6
    assert list(tmp_path.iterdir()) == []


def test_progress_is_told_chunk_by_chunk(sources, reader, tmp_path):
    told = []
    read(sources, reader, tmp_path, report=lambda done, total: told.append((done, total)))
    total = sum(source.task_count for source in sources)
    assert told[-1] == (total, total)
    assert [done for done, _ in told[:2]] == [5, 10]


def test_the_disk_limit_takes_a_share_of_every_source(sources, reader, tmp_path):
    whole = read(sources, reader, tmp_path / "whole")
    size = sum(path.stat().st_size for path in (tmp_path / "whole").iterdir())
    told = []
    limits = {"limit_bytes": size // 2, "report": lambda done, total: told.append((done, total))}
    few = read(sources, reader, tmp_path / "few", **limits)
    assert 0.3 * size < sum(path.stat().st_size for path in (tmp_path / "few").iterdir()) < 0.8 * size
    assert told[-1][0] == told[-1][1] < sum(source.task_count for source in sources)
    assert set(few.source.tolist()) == {0, 1}
    for source in (0, 1):
        assert 0.2 < (few.source == source).sum() / (whole.source == source).sum() < 0.9
    calls = reader.calls
    assert as_bytes(read(sources, reader, tmp_path / "few", **limits)) == as_bytes(few)
    assert reader.calls == calls


@pytest.mark.parametrize("share", [0.5, 0.25, 0.125, 0.75])
def test_a_limit_leaves_out_tasks_of_every_kind(share):
    """Tasks come in pairs: every second one would be all frames as they are, or all transformed."""
    taken = np.array(module._taken(400, share))
    assert taken.mean() == pytest.approx(share, abs=0.02)
    for period in (2, 3, 4):
        for phase in range(period):
            assert taken[phase::period].mean() == pytest.approx(share, abs=0.1)


def test_without_a_need_nothing_is_left_out():
    assert all(module._taken(1000, 1.0))
    assert module._taken(0, 0.5) == []


def full_disk(*_: object, **__: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("where", ["numpy.savez", "os.replace"])
def test_a_full_disk_is_one_line_and_keeps_earlier_chunks(sources, reader, tmp_path, monkeypatch, where):
    def fill_up(done, total):
        if done >= 10:
            monkeypatch.setattr(where, full_disk)

    message = refusal(OutputError, lambda: read(sources, reader, tmp_path / "features", report=fill_up))
    assert "No space left" in message
    assert "features" in message
    assert "--resume" in message
    assert sorted(path.name for path in (tmp_path / "features").iterdir()) == ["chunk-000000.npz", "chunk-000001.npz"]
    monkeypatch.undo()
    monkeypatch.setattr(module, "CHUNK_TASKS", 5)
    assert len(read(sources, reader, tmp_path / "features")) > 0


def test_a_folder_that_cannot_be_made_is_one_line(sources, reader, tmp_path):
    (tmp_path / "file").write_text("")
    assert "-o" in refusal(OutputError, lambda: read(sources, reader, tmp_path / "file" / "features"))


def pickled(path) -> None:
    with zipfile.ZipFile(path, "w") as file:
        for name in ("identity", "source"):
            with file.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array(member, np.array([{"a": 1}], object), allow_pickle=True)


def with_header(path, header: bytes, body: bytes = b"") -> None:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("identity.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + body)


def change(path, **columns) -> None:
    with np.load(path) as file:
        np.savez(path, **({name: file[name] for name in file.files} | columns))


def flip(path, place: int) -> None:
    content = bytearray(path.read_bytes())
    content[place] ^= 0xFF
    path.write_bytes(content)


HOSTILE = {
    "empty": lambda path: path.write_bytes(b""),
    "text": lambda path: path.write_text("not a zip"),
    "cut short": lambda path: path.write_bytes(path.read_bytes()[:-30]),
    "a flipped bit": lambda path: flip(path, path.stat().st_size // 2),
    "no arrays": lambda path: with_header(path, b""),
    "pickled objects": pickled,
    "compressed": lambda path: np.savez_compressed(path, identity=np.zeros(100_000, np.int64)),
    "promises too much": lambda path: with_header(
        path, b"{'descr': '<i8', 'fortran_order': False, 'shape': (1000000000000,), }\n"
    ),
    "negative shape": lambda path: with_header(path, b"{'descr': '<i8', 'fortran_order': False, 'shape': (-1,), }\n"),
    "deep header": lambda path: with_header(path, b"(" * 9000),
    "text in the columns": lambda path: change(path, identity=np.array(["a", "b"])),
    "one number": lambda path: change(path, identity=np.int64(3)),
    "fewer rows in one column": lambda path: change(path, identity=np.zeros(1, np.int64)),
    "other features": lambda path: change(path, value_points=np.zeros((3, 2), np.float16)),
    "another dtype": lambda path: change(path, height_px=np.load(path)["height_px"].astype(np.float64)),
    "another column": lambda path: change(path, more=np.load(path)["identity"]),
    "unknown identities": lambda path: change(path, identity=np.load(path)["identity"] + 1000),
    "negative identities": lambda path: change(path, identity=np.load(path)["identity"] - 1000),
    "identities of another source": lambda path: change(path, source=1 - np.load(path)["source"]),
    "no such source": lambda path: change(path, source=np.load(path)["source"] + 7),
    "heights of nothing": lambda path: change(path, height_px=np.load(path)["height_px"] * 0),
    "negative frames": lambda path: change(path, frame=np.load(path)["frame"] - 1000),
}


@pytest.mark.filterwarnings("ignore:Reading `.npy`")
@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("name", HOSTILE)
def test_damaged_and_foreign_chunks_are_one_line(sources, reader, tmp_path, name, number):
    read(sources, reader, tmp_path)
    calls = reader.calls
    HOSTILE[name](tmp_path / f"chunk-{number:06d}.npz")
    message = refusal(ConfigError, lambda: read(sources, reader, tmp_path))
    assert str(tmp_path) in message
    assert "--overwrite" in message
    assert reader.calls == calls


@pytest.mark.parametrize(
    "name", ["empty", "text", "cut short", "a flipped bit", "pickled objects", "compressed", "promises too much"]
)
def test_a_damaged_chunk_is_not_whole(name, tmp_path):
    path = tmp_path / "chunk.npz"
    write_chunk(path, {"identity": np.arange(30), "frame": np.arange(30)})
    assert is_whole_chunk(path)
    HOSTILE[name](path)
    assert not is_whole_chunk(path)


def test_chunks_of_no_rows_are_fine(tmp_path):
    paths = [tmp_path / f"{n}.npz" for n in range(3)]
    write_chunk(paths[0], {})
    write_chunk(paths[1], {"a": np.arange(6).reshape(3, 2)})
    write_chunk(paths[2], {})
    assert read_chunks(paths)["a"].tolist() == [[0, 1], [2, 3], [4, 5]]
    assert read_chunks(paths[:1]) == {}
    assert read_chunks([]) == {}


def test_chunks_are_in_memory_once(tmp_path):
    import tracemalloc

    paths = [tmp_path / f"{n}.npz" for n in range(10)]
    for path in paths:
        write_chunk(path, {"value_points": np.ones((100, 1000), np.float16)})
    tracemalloc.start()
    columns = read_chunks(paths)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    size = columns["value_points"].nbytes
    assert size == 2_000_000
    assert most < 1.5 * size


def test_features_beyond_half_precision_stay_finite(sources, reader, tmp_path, monkeypatch):
    """The largest float16 is 65,504; a larger feature would have become infinite, and the loss not a number."""
    inner = CountingReader.__call__
    monkeypatch.setattr(
        CountingReader, "__call__", lambda *a: {name: values * 1e9 for name, values in inner(*a).items()}
    )
    assert np.isfinite(read(sources, reader, tmp_path).values["points"]).all()
