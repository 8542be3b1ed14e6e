"""Charts as SVG: precision and recall, and distances of descriptors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from lookonce.evaluation import PrecisionRecall
from lookonce.report.described import Descriptors
from lookonce.report.markup import Content, Fragment, element
from lookonce.report.tables import table

__all__ = ["curve_chart", "curve_table", "distance_chart"]

_WIDTH, _HEIGHT = 560, 340
_LEFT, _TOP, _RIGHT, _BOTTOM = 40, 30, 14, 40
_MOST_POINTS = 300
_DASHES = ("", "8 4", "2 4", "10 3 2 3", "5 5", "14 4")


def _x(share: float) -> float:
    return _LEFT + share * (_WIDTH - _LEFT - _RIGHT)


def _y(share: float) -> float:
    return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)


def _frame(x_name: str, y_name: str, x_ticks: Sequence[tuple[float, str]], y_ticks: Sequence[float]) -> list[Fragment]:
    """Grid, ticks and names of both axes."""
    parts = []
    for share in y_ticks:
        parts.append(element("line", x1=_x(0), x2=_x(1), y1=_y(share), y2=_y(share), class_="grid"))
        parts.append(element("text", f"{share:g}", x=_LEFT - 8, y=_y(share) + 4, text_anchor="end"))
    for share, text in x_ticks:
        parts.append(element("text", text, x=_x(share), y=_HEIGHT - _BOTTOM + 18, text_anchor="middle"))
    parts.append(element("text", x_name, x=_x(0.5), y=_HEIGHT - 4, text_anchor="middle"))
    parts.append(element("text", y_name, x=2, y=14))
    return parts


def curve_chart(curves: Mapping[str, PrecisionRecall]) -> Fragment:
    """Precision over recall, a line for each run."""
    ticks = [(share / 5, f"{share / 5:g}") for share in range(6)]
    parts = _frame("recall", "precision", ticks, [share / 5 for share in range(6)])
    for number, curve in enumerate(curves.values()):
        parts.append(
            element("path", d=_curve_path(curve), class_=f"curve c{number % 8}", stroke_dasharray=_dash(number))
        )
    said = "; ".join(
        f"{name}: area {curve.area():.3f}" if curve.boxes else f"{name}: no true boxes"
        for name, curve in curves.items()
    )
    return element(
        "svg", *parts, viewBox=f"0 0 {_WIDTH} {_HEIGHT}", class_="chart", role="img",
        aria_label=f"Precision over recall. {said}",
    )  # fmt: skip


def _dash(number: int) -> str | None:
    return _DASHES[number % len(_DASHES)] or None


def _curve_path(curve: PrecisionRecall) -> str:
    """The curve through at most 300 points that a threshold can reach: of rows of equal score the last."""
    reachable = np.flatnonzero(np.diff(curve.scores, append=-np.inf) != 0)
    if not len(reachable):
        return "M0 0"
    chosen = reachable[np.unique(np.linspace(0, len(reachable) - 1, _MOST_POINTS).round().astype(np.int64))]
    points = zip(curve.recall[chosen].tolist(), curve.precision[chosen].tolist(), strict=True)
    return "M" + "L".join(f"{_x(recall):.1f} {_y(precision):.1f}" for recall, precision in points)


def curve_table(curves: Mapping[str, PrecisionRecall]) -> Fragment:
    """Area and best threshold of each run, beside a sample of its line."""
    rows: list[list[Content]] = []
    for number, (name, curve) in enumerate(curves.items()):
        best = curve.best_f1()
        is_any = math.isfinite(best.threshold)
        sample = element(
            "svg",
            element(
                "line", x1=0, x2=36, y1=6, y2=6, class_=f"curve c{number % 8}", stroke_dasharray=_dash(number)
            ),
            class_="swatch chart",
            aria_hidden="true",
        )  # fmt: skip
        rows.append(
            [
                [sample, " ", name],
                f"{len(curve.scores):,}",
                f"{curve.area():.3f}" if curve.boxes else "-",
                f"{curve.recall[-1]:.3f}" if len(curve.recall) else "-",
                f"{best.f1:.3f}" if is_any else "-",
                f"{best.threshold:.2f}" if is_any else "-",
            ]
        )
    return table(["run", "detections", "area (AP)", "largest recall", "best F1", "at score above"], rows)


def distance_chart(found: Descriptors) -> Fragment:
    """Both distributions of distances, and the match threshold."""
    kinds = {"same": np.array(found.genuine, np.float64), "other": np.array(found.impostor, np.float64)}
    shares = {name: counts / max(1.0, float(counts.sum())) for name, counts in kinds.items()}
    most = max(1e-9, *(float(share.max(initial=0)) for share in shares.values()))
    parts = _frame(
        "distance of two descriptors (0 = equal, 2 = opposite)",
        "share of pairs",
        [(share / 4, f"{share / 2:g}") for share in range(5)],
        [],
    )
    parts.append(element("line", x1=_x(0), x2=_x(1), y1=_y(0), y2=_y(0), class_="grid"))
    for name, share in shares.items():
        bins = len(share)
        steps = [f"L{_x(b / bins):.1f} {_y(v / most):.1f}H{_x((b + 1) / bins):.1f}" for b, v in enumerate(share)]
        parts.append(element("path", d=f"M{_x(0):.1f} {_y(0):.1f}{''.join(steps)}V{_y(0):.1f}Z", class_=name))
    if found.threshold:
        x = _x(found.threshold / 2)
        parts.append(element("line", x1=x, x2=x, y1=_y(0), y2=_y(1), class_="limit"))
        is_left = found.threshold > 1.2
        parts.append(
            element(
                "text", f"match threshold {found.threshold:.2f}", x=x + (-6 if is_left else 6), y=_y(0.97),
                text_anchor="end" if is_left else "start",
            )
        )  # fmt: skip
    said = (
        f"Distances of descriptors: {sum(found.genuine):,} pairs of one object, {sum(found.impostor):,} of two; "
        f"area under the ROC curve {found.roc_auc:.3f}"
    )
    return element("svg", *parts, viewBox=f"0 0 {_WIDTH} {_HEIGHT}", class_="chart", role="img", aria_label=said)
