"""A tracker's whole state in one file, so that a run goes on as if it had never stopped."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookonce.array_file import read_arrays, write_arrays
from lookonce.distances import COARSE, FINE, Quantized
from lookonce.errors import ConfigError, FormatError
from lookonce.structures import NO_ID
from lookonce.tracking.clock import Clock
from lookonce.tracking.default import DefaultRule
from lookonce.tracking.default_config import DefaultConfig
from lookonce.tracking.filling import MOST_PASSED
from lookonce.tracking.looks import LATEST
from lookonce.tracking.motion import LOGARITHMS, MOTION_ROWS, VARIANCES
from lookonce.tracking.motion_config import MotionConfig
from lookonce.tracking.objects import EvidenceConfig, Objects
from lookonce.tracking.paper import PaperConfig, PaperObjects, PaperRule
from lookonce.tracking.waiting import WaitingRow

__all__ = ["load_rule", "save_rule"]

_FORMAT, _VERSION = "lookonce-tracker", 5
_MOST_BYTES = 4_000_000_000  # 800,000 objects of 128 values
_MOST_ABOUT = 100_000  # bytes
_REMEDY = "give a file that Tracker.save wrote"
_LARGEST_LOGARITHM = 200.0  # of a size in px
_LARGEST = 1e30  # far above any
_LARGEST_OF = {"newest": FINE, "second": FINE, "references": FINE, "latest": COARSE, "kept": COARSE}  # descriptors

_OBJECTS: dict[str, type] = {
    "serials": np.int64,
    "ids": np.int64,
    "labels": np.int64,
    "votes": np.float64,
    "seen_s": np.float64,
    "hits": np.int64,
    "score_mean": np.float64,
    "score_peak": np.float64,
    "anchor": np.float64,
    "heading": np.float64,
    "carried": np.float64,
    "left_behind": np.float64,
    "surprise": np.float64,
    "box": np.float64,
    "travels": np.int64,
    "travel_s": np.float64,
    "is_real": np.bool_,
}
_WIDTHS = {"anchor": (2,), "heading": (2,), "carried": (2,), "surprise": (4,), "box": (4,)}
_LOOKS: dict[str, type] = {
    "latest": np.float32,
    "kept": np.float32,
    "kept_squared": np.float32,
    "seen": np.int64,
    "view_count": np.int64,
    "view_s": np.float64,
}
_WAITING: dict[str, type] = {"waiting": np.int64, "waiting_xyxy": np.float32, "waiting_scores": np.float32}
_STREAM: dict[str, type] = {
    "extent": np.float64,
    "moving": np.float64,
    "steadying": np.float64,
    "jolt_speed": np.float64,
    "passed": np.int64,
    "passed_s": np.float64,
    "motions": np.float64,
}
_DEFAULT: dict[str, type] = _STREAM | _OBJECTS | _LOOKS | _WAITING
_PAPER: dict[str, type] = {
    "paper_ids": np.int64,
    "paper_seen": np.int64,
    "newest": np.float64,
    "second": np.float64,
    "references": np.float64,
}


def save_rule(path: Path, rule: DefaultRule | PaperRule, dropped_rows: int) -> None:
    """Write the state of a rule.

    Raises:
        OutputError: it cannot be written.
    """
    about: dict[str, Any] = {"format": _FORMAT, "version": _VERSION, "dropped_rows": dropped_rows}
    about |= {"config": asdict(rule.config), "next_id": rule.next_id}
    if isinstance(rule, PaperRule):
        about["preset"], arrays = "paper", _of_paper(rule)
    else:
        about |= {"preset": "default", "next_serial": rule.next_serial, "size": rule.looks.size}
        about["clock"] = asdict(rule.clock)
        arrays = _of_default(rule)
    text = json.dumps(about, allow_nan=False).encode()
    write_arrays(path, {"about": np.frombuffer(text, np.uint8), **arrays})


def load_rule(path: Path) -> tuple[DefaultRule | PaperRule, int]:
    """The rule as it was saved, and how many rows had been dropped.

    Raises:
        FormatError: the file is something else, of another version, damaged or cut short.
    """
    arrays = read_arrays(path, {"about": np.uint8} | _DEFAULT | _PAPER, _MOST_BYTES, _REMEDY)
    about = _about(path, arrays.pop("about", np.zeros(0, np.uint8)))
    try:
        rule = _paper(about, arrays) if about.get("preset") == "paper" else _default(about, arrays)
        return rule, _count(about, "dropped_rows")
    except (ValueError, KeyError, TypeError, IndexError, OverflowError, ConfigError) as exc:
        raise FormatError(path, 0, f"holds what cannot be a tracker's state ({exc}); {_REMEDY}") from exc


def _about(path: Path, text: NDArray[np.uint8]) -> dict[str, Any]:
    try:
        about = json.loads(text.tobytes().decode()) if 0 < text.size <= _MOST_ABOUT else None
    except (ValueError, RecursionError):
        about = None
    if not isinstance(about, dict) or about.get("format") != _FORMAT:
        raise FormatError(path, 0, f"is no tracker's state; {_REMEDY}")
    if about.get("version") != _VERSION:
        raise FormatError(
            path, 0, f"of version {about.get('version')}, expected {_VERSION}; use the lookonce that wrote it"
        )
    return about


def _count(about: dict[str, Any], name: str, least: int = 0) -> int:
    value = about[name]
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value < 2**62:
        raise ValueError(f"{name}: expected a whole number from {least}, got {value}")
    return value


def _of_default(rule: DefaultRule) -> dict[str, NDArray[Any]]:
    objects, looks, slots = rule.objects, rule.looks, rule.objects.slots
    moving = np.array([rule.moving.count, rule.moving.mean, rule.moving.squares])
    arrays: dict[str, NDArray[Any]] = {
        "extent": rule.border.extent,
        "moving": moving,
        "steadying": rule.own_boxes.steadying.state(),
        "jolt_speed": rule.jolt_speed,
    }
    arrays["passed"] = np.array([number for number, _ in rule.own_boxes.passed.frames], np.int64)
    arrays["passed_s"] = np.array([time_s for _, time_s in rule.own_boxes.passed.frames], np.float64)
    arrays |= {name: getattr(objects, name) for name in _OBJECTS}
    arrays["motions"] = objects.motions.values
    arrays |= looks.part(slots)
    arrays = {name: np.ascontiguousarray(values) for name, values in arrays.items()}
    rows = list(rule.waiting)
    numbers = [(serial, row.frame, row.row, row.label) for serial, row in rows]
    arrays["waiting"] = np.array(numbers, np.int64).reshape(-1, 4)
    arrays["waiting_xyxy"] = np.array([row.xyxy for _, row in rows], np.float32).reshape(-1, 4)
    arrays["waiting_scores"] = np.array([row.score for _, row in rows], np.float32)
    return arrays


def _default(about: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> DefaultRule:
    settings = dict(about["config"])
    motion, evidence = MotionConfig(**settings.pop("motion")), EvidenceConfig(**settings.pop("evidence"))
    rule = DefaultRule(DefaultConfig(**settings, motion=motion, evidence=evidence))
    rule.clock = _clock(about["clock"])
    rule.next_id, rule.next_serial = _count(about, "next_id", 1), _count(about, "next_serial")
    count = len(arrays["ids"])
    shapes: dict[str, tuple[int, ...]] = {name: (count, *_WIDTHS.get(name, ())) for name in _OBJECTS}
    _check(
        arrays,
        shapes
        | {"extent": (4,), "moving": (3,), "steadying": (5,), "jolt_speed": (2,), "motions": (MOTION_ROWS, count)},
        may_be_infinite=("extent", "travel_s", "surprise"),
    )
    _check_filters(arrays["motions"])
    _check_surprises(arrays["surprise"])
    if (arrays["seen_s"] > rule.clock.now_s).any():
        raise ValueError("seen_s: expected times up to the last frame's")
    if (np.diff(arrays["serials"]) <= 0).any() or (arrays["serials"] >= rule.next_serial).any():
        raise ValueError("serials: expected rising numbers that were given out")
    known = arrays["ids"][arrays["ids"] != NO_ID]
    if len(np.unique(known)) < len(known) or (known < 1).any() or (known >= rule.next_id).any():
        raise ValueError("ids: expected each once, from those that were given out")
    rule.border.extent = arrays["extent"]
    rule.moving.count, rule.moving.mean, rule.moving.squares = arrays["moving"].tolist()
    rule.own_boxes.steadying.restore(arrays["steadying"])
    rule.jolt_speed = arrays["jolt_speed"]
    rule.own_boxes.last_s = rule.clock.now_s
    _restore_passed(rule, arrays)
    _restore_looks(rule, about["size"], arrays, count)
    none = np.zeros(count, np.int64)
    rule.objects = Objects.begin(
        none, np.arange(count), none, np.zeros(count), np.zeros((count, 4)), 0.0, rule.config.motion
    )
    for name in _OBJECTS:
        getattr(rule.objects, name)[:] = arrays[name]
    rule.objects.motions.values[:] = arrays["motions"]
    _restore_waiting(rule, arrays)
    return rule


def _clock(about: dict[str, Any]) -> Clock:
    seconds = [float(about[name]) for name in ("now_s", "given_s", "offset_s")]
    if not all(math.isfinite(one) for one in seconds):
        raise ValueError("now_s, given_s, offset_s: expected finite seconds")
    now_s, given_s, offset_s = seconds
    return Clock(_count(about, "frame", -1), now_s, given_s, offset_s, _count(about, "faults"))


def _check_filters(values: NDArray[np.float64]) -> None:
    variances, logarithms = values[list(VARIANCES)], values[list(LOGARITHMS)]
    if (variances < 0).any() or (np.abs(logarithms) > _LARGEST_LOGARITHM).any():
        raise ValueError("motions: expected variances from 0 and sizes within reason")


def _check_surprises(values: NDArray[np.float64]) -> None:
    is_none, is_small = (values == np.inf).all(axis=1), (np.abs(values) <= 1).all(axis=1)
    if not (is_none | is_small).all():
        raise ValueError("surprise: expected numbers up to 1, or none at all")


def _restore_passed(rule: DefaultRule, arrays: dict[str, NDArray[Any]]) -> None:
    count = len(arrays["passed"])
    _check(arrays, {"passed": (count,), "passed_s": (count,)})
    if count > MOST_PASSED or (np.diff(arrays["passed_s"]) < 0).any() or (arrays["passed_s"] > rule.clock.now_s).any():
        raise ValueError(f"passed: expected at most {MOST_PASSED} frames at times that do not fall")
    rule.own_boxes.passed.frames.extend(zip(arrays["passed"].tolist(), arrays["passed_s"].tolist(), strict=True))


def _restore_looks(rule: DefaultRule, size: object, arrays: dict[str, NDArray[Any]], count: int) -> None:
    looks = rule.looks
    if size is None:
        looks.take(count)
        return
    if not isinstance(size, int) or isinstance(size, bool) or not 0 < size <= 1 << 16:
        raise ValueError(f"size: expected the length of descriptors, got {size}")
    views = 1 + looks.views
    shapes: dict[str, tuple[int, ...]] = {
        "latest": (count, LATEST, size),
        "kept": (count, views, size),
        "kept_squared": (count, views),
    }
    _check(arrays, shapes | dict.fromkeys(("seen", "view_count", "view_s"), (count,)), ("kept_squared", "view_s"))
    looks.check_size(size)
    looks.take(count)
    looks.restore(arrays)


def _restore_waiting(rule: DefaultRule, arrays: dict[str, NDArray[Any]]) -> None:
    count = len(arrays["waiting"])
    _check(arrays, {"waiting": (count, 4), "waiting_xyxy": (count, 4), "waiting_scores": (count,)})
    alive = set(rule.objects.serials.tolist())
    for number, (serial, frame, row, label) in enumerate(arrays["waiting"].tolist()):
        if serial not in alive:
            raise ValueError("waiting: expected rows of objects that are alive")
        box, score = arrays["waiting_xyxy"][number], float(arrays["waiting_scores"][number])
        rule.waiting.add(serial, WaitingRow(frame, row, box, score, label))


def _of_paper(rule: PaperRule) -> dict[str, NDArray[Any]]:
    objects = rule.objects
    if objects is None:
        return {}
    return {
        "paper_ids": objects.ids,
        "paper_seen": objects.seen,
        "newest": objects.newest,
        "second": objects.second,
        "references": objects.references.units,
    }


def _paper(about: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> PaperRule:
    rule = PaperRule(PaperConfig(**about["config"]))
    rule.next_id = _count(about, "next_id", 1)
    if not arrays:
        return rule
    count, size = arrays["newest"].shape
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("newest", "second", "references"), (count, size))
    _check(arrays, shapes | dict.fromkeys(("paper_ids", "paper_seen"), (count,)))
    rule.objects = PaperObjects(
        arrays["paper_ids"],
        arrays["paper_seen"],
        arrays["newest"],
        arrays["second"],
        Quantized.of(arrays["references"]),
    )
    return rule


def _check(
    arrays: Mapping[str, NDArray[Any]], shapes: Mapping[str, tuple[int, ...]], may_be_infinite: tuple[str, ...] = ()
) -> None:
    for name, shape in shapes.items():
        values = arrays[name]
        if values.shape != shape:
            raise ValueError(f"{name}: expected {shape}, got {values.shape}")
        if values.dtype.kind != "f":
            continue
        largest = 2.0 * _LARGEST_OF[name].scale if name in _LARGEST_OF else _LARGEST
        if np.isnan(values).any() or (name not in may_be_infinite and (np.abs(values) > largest).any()):
            raise ValueError(f"{name}: holds numbers that are not finite, or far too large")
