"""How far apart descriptors put boxes of one object and boxes of two, as a picture."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lookonce.evaluation import PairDistances, equal_error_rate, rates_at
from lookonce.make.probing.whole_file import write_whole

__all__ = ["draw_distances"]

# Blue and orange of Okabe and Ito's palette: told apart by every kind of colour vision, and in grey by lightness.
_GENUINE_COLOUR, _IMPOSTOR_COLOUR = "#0072B2", "#E69F00"
_SIZE_INCHES = (10.0, 4.5)
_DPI = 120
_DRAWN_BINS = 128  # about five px each
_SPIKE_WIDTH = 3  # bins; what is narrower and stands out by this factor is cut off, so that the rest can be seen
_SPIKE_FACTOR = 4.0


def draw_distances(path: Path, pairs: PairDistances, threshold: float, gaps: str = "") -> None:
    """Write a PNG of 1200 x 540 px: both distributions of distances, the match threshold, the equal error rate.

    Args:
        path: the file; an existing one is replaced.
        pairs: the distances; a kind of pair that is missing is drawn as nothing.
        threshold: distance below which a tracker takes two boxes for one object; NaN = none to draw.
        gaps: how far apart the boxes of a pair lie, for people, such as ``0.5 to 30 s``; the pairs' frames by default.

    Raises:
        OutputError: the file cannot be written.
    """
    figure = Figure(figsize=_SIZE_INCHES, dpi=_DPI, facecolor="white", layout="constrained")
    axes = figure.add_subplot()
    _draw_kind(axes, pairs.genuine, _GENUINE_COLOUR, "//", "-", "same object")
    _draw_kind(axes, pairs.impostor, _IMPOSTOR_COLOUR, "..", "--", "different objects")
    _cut_spike_off(axes, pairs)
    _draw_thresholds(axes, pairs, threshold)
    axes.set_xlim(0, 2)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("Euclidean distance of two descriptors of unit length (0 = equal, 2 = opposite)")
    axes.set_ylabel("share of pairs per 0.1 of distance")
    axes.set_title(_title(pairs, gaps), fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right upper", frameon=False, fontsize=9)  # within the axes it would hide something
    picture = io.BytesIO()
    figure.savefig(picture, format="png", metadata={"Software": None})  # the version would change the bytes
    write_whole(path, picture.getvalue())


def _draw_kind(axes: Axes, counts: NDArray[np.int64], colour: str, hatch: str, line: str, name: str) -> None:
    total = int(counts.sum())
    if not total:
        axes.plot([], [], color=colour, linestyle=line, label=f"{name}: no pairs")
        return
    edges, share = _drawn_bins(counts)
    axes.stairs(
        share * 0.1 / np.diff(edges),
        edges,
        fill=True,
        facecolor=(colour, 0.25),
        edgecolor=colour,
        hatch=hatch,
        linestyle=line,
        linewidth=1.5,
        label=f"{name}: {total:,} pairs",
    )


def _drawn_bins(counts: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Edges (B + 1,) of the bins that are drawn, and the share of the pairs in each (B,); zeros without pairs."""
    edges = np.linspace(0, 2, min(_DRAWN_BINS, len(counts)) + 1)
    below = np.concatenate([[0], np.cumsum(counts)])
    share: NDArray[np.float64] = np.diff(np.interp(edges, np.linspace(0, 2, len(below)), below))
    return edges, share / max(1, int(counts.sum()))


def _cut_spike_off(axes: Axes, pairs: PairDistances) -> None:
    """Limit the height of the axes to what lies beside a narrow peak, and write beside the peak what it holds.

    Descriptors of different grids may all lie equally far apart, which gives one bar that dwarfs all others.
    """
    edges, genuine = _drawn_bins(pairs.genuine)
    impostor = _drawn_bins(pairs.impostor)[1]
    highest = np.maximum(genuine, impostor)
    beside = np.pad(highest, _SPIKE_WIDTH)
    is_spike = highest > _SPIKE_FACTOR * np.maximum(beside[: -2 * _SPIKE_WIDTH], beside[2 * _SPIKE_WIDTH :])
    rest = float(highest[~is_spike].max(initial=0))
    held = genuine[is_spike].sum(), impostor[is_spike].sum()
    if max(held) > 0.5 or highest.max() < _SPIKE_FACTOR * rest or not rest:
        return
    top = 1.25 * rest * 0.1 / float(edges[1])
    axes.set_ylim(top=top)
    where = int(np.where(is_spike, highest, 0).argmax())
    has_room = edges[where] < 1.45  # to its right
    axes.annotate(
        f"cut off: {held[0]:.0%} of the same,\n{held[1]:.0%} of different objects",
        (float(edges[where + has_room]), top),
        xytext=(6 if has_room else -6, -4),
        textcoords="offset points",
        horizontalalignment="left" if has_room else "right",
        verticalalignment="top",
        fontsize=9,
    )


def _draw_thresholds(axes: Axes, pairs: PairDistances, threshold: float) -> None:
    rate, where = equal_error_rate(pairs)
    if not math.isnan(rate):
        axes.axvline(where, color="0.45", linestyle=":", linewidth=1.5, label=_eer_label(rate, where))
    if not math.isnan(threshold):
        false_accepts, false_rejects = rates_at(pairs, threshold)
        label = f"match threshold {threshold:.2f}"
        if not math.isnan(false_rejects):
            label += f"\nmisses {false_rejects:.1%} of the same"
        if not math.isnan(false_accepts):
            label += f"\naccepts {false_accepts:.1%} of different ones"
        axes.axvline(threshold, color="black", linewidth=2, label=label)


def _eer_label(rate: float, where: float) -> str:
    return f"equal error rate {rate:.1%} at {where:.2f}"


def _title(pairs: PairDistances, gaps: str) -> str:
    gaps = gaps or f"{pairs.min_gap_frames} to {pairs.max_gap_frames} frames"
    title = f"Distances of boxes {gaps} apart, {pairs.identities} objects"
    return title if pairs.share == 1 else f"{title}, {pairs.share:.1%} of all pairs"
