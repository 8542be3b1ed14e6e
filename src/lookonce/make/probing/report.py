"""What a probe leaves behind: two pictures, and all numbers as JSON."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from lookonce.datasets import LabelledSequence
from lookonce.make.probing.crops import neighbourhoods
from lookonce.make.probing.describing import OnFrame
from lookonce.make.probing.distances import draw_distances
from lookonce.make.probing.measuring import Measures
from lookonce.make.probing.neighbours import draw_neighbours
from lookonce.make.probing.probe import ProbeResult, ProbeSettings
from lookonce.make.probing.whole_file import write_whole

__all__ = ["PROBE_FILES", "report_json", "write_report"]

PROBE_FILES = ("neighbours.png", "distances.png", "probe.json")
_PACKAGES = ("lookonce", "numpy", "onnxruntime", "av")


def write_report(
    folder: Path, result: ProbeResult, sequences: Sequence[LabelledSequence], *, on_frame: OnFrame | None = None
) -> tuple[Path, ...]:
    """Write ``PROBE_FILES`` into a folder; what is there is replaced.

    Args:
        folder: made where it is missing.
        result: of ``probe``.
        sequences: those that were probed; their pictures are read again for the sheet.
        on_frame: told of the progress.

    Returns:
        The files.

    Raises:
        OutputError: one cannot be written.
        VideoError: the pictures cannot be read any more.
    """
    neighbours, distances, numbers = (folder / name for name in PROBE_FILES)
    limits = result.settings.limits
    window = limits.window(result.reading.objects)
    rows = neighbourhoods(result.reading, window, sequences, on_frame=on_frame)
    draw_neighbours(neighbours, rows)
    draw_distances(distances, result.overall.pairs, result.match_threshold, str(limits))
    write_whole(numbers, report_json(result).encode(), "numbers")
    return neighbours, distances, numbers


def report_json(result: ProbeResult) -> str:
    """All numbers of a probe as JSON; a rate of nothing and a limit that is infinite are null."""
    descriptor = result.metadata.descriptor
    content = {
        "model": {
            "file": result.path.name,
            "sha256": result.sha256,
            "size": result.metadata.size,
            "descriptor": asdict(descriptor) if descriptor else None,
        },
        "settings": _settings(result.settings),
        "match_threshold": {"value": result.match_threshold, "source": result.threshold_source},
        "overall": _measures(result.overall),
        "sequences": [
            asdict(tally) | _measures(measures)
            for tally, measures in zip(result.tallies, result.by_sequence, strict=True)
        ],
        "parts": {by: [asdict(part) for part in parts] for by, parts in result.parts.items()},
        "advice": result.advice,
        "versions": {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
    }
    return json.dumps(_finite(content), ensure_ascii=False, indent=2, allow_nan=False) + "\n"


def _settings(settings: ProbeSettings) -> dict[str, object]:
    limits = settings.limits
    gaps = {"min_gap": str(limits.least), "max_gap": str(limits.most), "rank_gap": str(limits.rank)}
    return {name: value for name, value in asdict(settings).items() if name != "limits"} | gaps


def _measures(measures: Measures) -> dict[str, object]:
    return {
        "objects": measures.objects,
        "identities": measures.identities,
        "genuine_pairs": measures.pairs.genuine_count,
        "impostor_pairs": measures.pairs.impostor_count,
        "compared_share": measures.pairs.share,
        "rank_one": asdict(measures.rank_one),
        "mean_average_precision": measures.retrieval.mean_average_precision,
        "mean_average_precision_queries": measures.retrieval.queries,
        "roc_auc": measures.roc_auc,
        "equal_error_rate": measures.equal_error_rate,
        "equal_error_threshold": measures.equal_error_threshold,
        "false_accept_rate": measures.false_accept_rate,
        "false_reject_rate": measures.false_reject_rate,
    }


def _finite(value: object) -> object:
    """The same with null for NaN and infinity, which JSON does not know."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_finite(item) for item in value]
    return value
