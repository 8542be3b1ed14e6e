"""A tracker that was saved and loaded goes on as if it had never stopped; what is no state is refused."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from lookonce import Detections, FormatError, OutputError
from lookonce.tracking import PRESETS, Tracker

COUNT = 12


def crowd(frames: int = 40, size: int = 16, seed: int = 3) -> list[Detections]:
    """Objects that cross, hide and come back, with low scores, doubles and zero vectors among them."""
    rng = np.random.default_rng(seed)
    place, velocity = rng.uniform(0, 200, (COUNT, 2)), rng.normal(0, 40, (COUNT, 2))
    looks = rng.normal(size=(COUNT, size))
    result = []
    for _ in range(frames):
        place = place + velocity / 10
        velocity = np.where((place < 0) | (place > 200), -velocity, velocity)
        rows = np.flatnonzero(rng.random(COUNT) < 0.8)
        corner = place[rows] + rng.normal(0, 1, (len(rows), 2))
        descriptors = looks[rows] + rng.normal(0, 0.3, (len(rows), size))
        descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
        descriptors[rng.random(len(rows)) < 0.05] = 0
        xyxy = np.concatenate([corner, corner + np.array([14, 30])], axis=1).astype(np.float32)
        scores = rng.uniform(0.05, 1, len(rows)).astype(np.float32)
        result.append(Detections(xyxy, scores, rows % 3, descriptors.astype(np.float32)))
    return result


def run(tracker: Tracker, frames: list[Detections], first: int = 0) -> list[str]:
    """A digest of each frame's answer."""
    digests = []
    for number, detections in enumerate(frames, first):
        tracks = tracker.update(detections, number / 10)
        back = tracks.given_back
        digest = hashlib.sha256(tracks.ids.tobytes() + tracks.labels.tobytes() + tracks.unseen_ids.tobytes())
        digest.update(tracks.unseen_xyxy.tobytes() + back.frames.tobytes() + back.rows.tobytes() + back.ids.tobytes())
        digest.update(back.xyxy.tobytes() + back.scores.tobytes() + back.labels.tobytes() + tracks.xyxy.tobytes())
        filled = tracks.filled
        digest.update(filled.frames.tobytes() + filled.ids.tobytes() + filled.xyxy.tobytes() + filled.labels.tobytes())
        digests.append(digest.hexdigest())
    return digests


@pytest.mark.parametrize("preset", sorted(PRESETS))
@pytest.mark.parametrize("stop", [0, 1, 2, 7, 25])
def test_stopped_and_continued_is_never_stopped(tmp_path: Path, preset: str, stop: int) -> None:
    frames = crowd()
    whole = run(Tracker(preset), frames)
    tracker = Tracker(preset)
    before = run(tracker, frames[:stop])
    tracker.save(tmp_path / "state")
    loaded = Tracker.load(tmp_path / "state")
    assert loaded.config == tracker.config
    assert before + run(loaded, frames[stop:], stop) == whole
    assert run(tracker, frames[stop:], stop) == whole[stop:]  # saving changes nothing


def test_the_scene_has_what_a_state_must_hold() -> None:
    """Otherwise the test above would show little."""
    held = set()
    for stop in (2, 7, 25):
        tracker = Tracker()
        run(tracker, crowd()[:stop])
        rule = tracker._rule
        held |= {"rows that wait"} if rule.waiting else set()
        held |= {"confirmed"} if (rule.objects.ids > 0).sum() > 3 else set()
        held |= {"views"} if (rule.looks.view_count > 0).any() else set()
        held |= {"hidden"} if (rule.objects.seen_s < rule.clock.now_s).any() else set()
        held |= {"scores"} if rule.moving.count else set()
        held |= {"surprises"} if rule.own_boxes.steadying.pairs > 50 else set()
        held |= {"gaps"} if len(tracker.filled) else set()
    assert held == {"rows that wait", "confirmed", "views", "hidden", "scores", "surprises", "gaps"}


def test_a_moving_camera_goes_on(tmp_path: Path) -> None:
    def answers(tracker: Tracker, first: int, frames: list[Detections]) -> list[bytes]:
        camera = np.array([[1.0, 0.01, 2.0], [-0.01, 1.0, 1.0]])
        found = [tracker.update(one, number / 10, camera=camera) for number, one in enumerate(frames, first)]
        return [one.ids.tobytes() + one.xyxy.tobytes() + one.filled.xyxy.tobytes() for one in found]

    frames = crowd()
    whole, tracker = answers(Tracker(), 0, frames), Tracker()
    answers(tracker, 0, frames[:20])
    tracker.save(tmp_path / "state")
    assert answers(Tracker.load(tmp_path / "state"), 20, frames[20:]) == whole[20:]


def test_times_too_large_to_tell_apart_are_saved_and_loaded(tmp_path: Path) -> None:
    """Microseconds since 1970 that stand still: a millisecond more is lost in rounding."""
    tracker = Tracker("iou")
    for _ in range(5):
        tracker.update(np.array([[10, 10, 50, 90, 0.9, 0]]), 1.7e15)
    tracker.save(tmp_path / "state")
    assert Tracker.load(tmp_path / "state").update(np.array([[10, 10, 50, 90, 0.9, 0]]), 1.7e15)[0, 6] == 1


def test_without_descriptors(tmp_path: Path) -> None:
    frames = [Detections(one.xyxy, one.scores, one.labels) for one in crowd()]
    whole = run(Tracker(), frames)
    tracker = Tracker()
    run(tracker, frames[:20])
    tracker.save(tmp_path / "state")
    assert run(Tracker.load(tmp_path / "state"), frames[20:], 20) == whole[20:]


def test_counts_go_on(tmp_path: Path) -> None:
    tracker = Tracker("iou")
    tracker.update(np.array([[0, 0, 10, 10, 0.9, 0], [np.nan, 0, 10, 10, 0.9, 0]]), 1.0)
    tracker.update(np.zeros((0, 6)), 0.5)
    tracker.save(tmp_path / "state")
    loaded = Tracker.load(tmp_path / "state")
    assert loaded.dropped_rows == 1
    assert loaded._rule.clock.faults == 1


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("state") / "state"
    tracker = Tracker()
    run(tracker, crowd(10))
    tracker.save(path)
    return path


def test_a_file_cut_short_is_refused_wherever_it_is_cut(saved: Path, tmp_path: Path) -> None:
    data = saved.read_bytes()
    for length in range(0, len(data) - 1, max(1, len(data) // 150)):
        (tmp_path / "cut").write_bytes(data[:length])
        with pytest.raises(FormatError, match="cut"):
            Tracker.load(tmp_path / "cut")


def test_a_damaged_file_is_refused_or_harmless(saved: Path, tmp_path: Path) -> None:
    data, rng = saved.read_bytes(), np.random.default_rng(0)
    refused = 0
    for _ in range(300):
        damaged = bytearray(data)
        damaged[rng.integers(len(data))] ^= 1 << rng.integers(8)
        (tmp_path / "damaged").write_bytes(damaged)
        try:
            run(Tracker.load(tmp_path / "damaged"), crowd(2))
        except FormatError:
            refused += 1
    assert refused > 200  # the rest fell on bytes that zip files do not use


def _rewritten(saved: Path, path: Path, **changes) -> Path:
    """The file with other arrays; the checksums are right."""
    with np.load(saved) as archive:
        arrays = dict(archive)
    arrays |= {name: values for name, values in changes.items() if values is not None}
    np.savez(path, allow_pickle=True, **{k: v for k, v in arrays.items() if changes.get(k, 0) is not None})
    return path.with_suffix(".npz")


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"ids": None}, id="an array is missing"),
        pytest.param({"more": np.zeros(1)}, id="an unknown array"),
        pytest.param({"ids": np.zeros(3, np.int64)}, id="another length"),
        pytest.param({"ids": np.zeros(3, np.float64)}, id="another dtype"),
        pytest.param({"ids": np.array([{}], object)}, id="a pickle"),
        pytest.param({"extent": np.full(4, np.nan)}, id="not a number"),
        pytest.param({"about": np.frombuffer(b"{}", np.uint8)}, id="not ours"),
        pytest.param({"about": np.frombuffer(b"[" * 5000, np.uint8)}, id="no JSON"),
        pytest.param({"about": np.zeros(1 << 20, np.uint8)}, id="a huge text"),
        pytest.param({"waiting": np.full((1, 4), 10**9)}, id="a row of nobody"),
        pytest.param({"steadying": np.array([1.0, 0, 0, -1, 1])}, id="negative squares"),
        pytest.param({"steadying": np.zeros(4)}, id="sums missing"),
        pytest.param({"passed": np.arange(2), "passed_s": np.array([0.2, 0.1])}, id="times that fall"),
        pytest.param({"passed": np.arange(1), "passed_s": np.array([1e6])}, id="a frame to come"),
        pytest.param({"passed": np.arange(999), "passed_s": np.linspace(0, 0.5, 999)}, id="too many frames"),
        pytest.param({"passed": np.arange(3), "passed_s": np.array([0.1])}, id="frames without times"),
    ],
)
def test_what_is_no_state_is_one_line(saved: Path, tmp_path: Path, changes) -> None:
    changes = dict(changes)
    if "waiting" in changes:
        changes |= {"waiting_xyxy": np.zeros((1, 4), np.float32), "waiting_scores": np.zeros(1, np.float32)}
    with pytest.raises(FormatError, match=r"Tracker\.save") as caught:
        Tracker.load(_rewritten(saved, tmp_path / "bad", **changes))
    assert "\n" not in str(caught.value)


CLOCK = {"frame": 100, "now_s": 4.0, "given_s": 4.0, "offset_s": 0.0, "faults": 0}


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        pytest.param("motions", (6, 0), -1.0, id="place-variance"),
        pytest.param("motions", (11, 0), -1.0, id="growth-variance"),
        pytest.param("motions", (12, 0), -1.0, id="size-variance"),
        pytest.param("motions", (2, 0), 1000.0, id="size-beyond-reason"),
        pytest.param("motions", (0, 0), np.nan, id="not-a-number"),
        pytest.param("motions", (13, 0), np.inf, id="infinite-growth"),
        pytest.param("surprise", (0, 1), np.inf, id="half-infinite-surprise"),
        pytest.param("surprise", (0, 0), 5.0, id="large-surprise"),
        pytest.param("surprise", (0,), -np.inf, id="surprise-below-all"),
        pytest.param("seen_s", (0,), 1e9, id="seen-in-future"),
        pytest.param("heading", (0, 0), np.nan, id="nowhere"),
    ],
)
def test_numbers_that_would_spoil_the_stream_are_refused(saved: Path, tmp_path: Path, name, place, value) -> None:
    with np.load(saved) as archive:
        values = archive[name].copy()
    values[place] = value
    with pytest.raises(FormatError, match=r"Tracker\.save"):
        Tracker.load(_rewritten(saved, tmp_path / "bad", **{name: values}))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param({"version": 99}, "version 99", id="version"),
        pytest.param({"next_id": 1}, "ids", id="ids not given out"),
        pytest.param({"next_id": "many"}, "next_id", id="no number"),
        pytest.param({"size": -1}, "size", id="negative size"),
        pytest.param({"config": {"unknown": 1}}, "state", id="unknown settings"),
        pytest.param({"clock": None}, "state", id="no clock"),
        pytest.param({"clock": CLOCK | {"now_s": None}}, "state", id="no time"),
        pytest.param({"clock": CLOCK | {"now_s": float("inf")}}, "now_s", id="endless clock"),
        pytest.param({"clock": CLOCK | {"offset_s": float("nan")}}, "offset_s", id="no offset"),
        pytest.param({"clock": CLOCK | {"frame": 1.5}}, "frame", id="half a frame"),
    ],
)
def test_what_the_text_says_is_checked(saved: Path, tmp_path: Path, change, message) -> None:
    with np.load(saved) as archive:
        about = json.loads(archive["about"].tobytes())
    text = json.dumps(about | change).encode()
    with pytest.raises(FormatError, match=message):
        Tracker.load(_rewritten(saved, tmp_path / "bad", about=np.frombuffer(text, np.uint8)))


def test_a_bomb_is_refused_before_it_is_unpacked(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lookonce.tracking.state._MOST_BYTES", 1000)
    monkeypatch.setattr("zipfile.ZipFile.read", None)  # nothing is unpacked
    with pytest.raises(FormatError, match="larger than"):
        Tracker.load(saved)


def test_missing_files_and_folders(tmp_path: Path, saved: Path) -> None:
    with pytest.raises(FormatError, match="nothing"):
        Tracker.load(tmp_path / "nothing")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        Tracker().save(tmp_path / "file" / "state")
    assert not list(tmp_path.glob("*.part"))
