"""GOG: all tracks of a sequence at once, as a flow of least cost.

L. Zhang, Y. Li, R. Nevatia: Global Data Association for Multi-Object Tracking Using Network Flows, CVPR 2008; H.
Pirsiavash, D. Ramanan, C. Fowlkes: Globally-Optimal Greedy Algorithms for Tracking a Variable Number of Objects, CVPR
2011. The latter solve the same problem greedily; here it is solved to the optimum by OR-Tools.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import iou
from lookonce.compare.detections import DetectedSequence

__all__ = ["FlowSettings", "associate_gog"]

_SCALE = 1000.0  # the solver takes whole numbers


@dataclass(frozen=True, slots=True)
class FlowSettings:
    """Costs are negative logarithms of probabilities, as published; a path that costs less than nothing is a track.

    Attributes:
        end_cost: of the start of a track, and of its end.
        overlap: smallest IoU of two boxes that may follow each other; the cost of the link is -log(IoU).
        gap_s: seconds that may lie between them; the next frame always may.
        gap_cost: of each frame in between without detection.
        certainty: scores are cut at this and at 1 less this; the cost of a detection is -log(score / (1 - score)).
    """

    end_cost: float = 3.0
    overlap: float = 0.3
    gap_s: float = 0.25
    gap_cost: float = 1.0
    certainty: float = 0.99


def associate_gog(sequence: DetectedSequence, settings: FlowSettings | None = None) -> NDArray[np.int64]:
    """Ids (R,) int64 of all rows, -1 for those in no track; knows the whole sequence before it answers."""
    settings = settings or FlowSettings()
    if not len(sequence):
        return np.zeros(0, np.int64)
    earlier, later, link_cost = _links(sequence, settings)
    return _ids(len(sequence), _chosen_links(sequence, settings, earlier, later, link_cost))


def _links(
    sequence: DetectedSequence, settings: FlowSettings
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Which rows may follow which, and at what cost: (L,), (L,), (L,)."""
    starts, times = sequence.starts, sequence.times
    parts: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]] = []
    for frame in range(len(times)):
        for other in range(frame + 1, len(times)):
            if other > frame + 1 and times[other] - times[frame] > settings.gap_s:
                break
            rows, columns = np.arange(starts[frame], starts[frame + 1]), np.arange(starts[other], starts[other + 1])
            overlap = iou(sequence.xyxy[rows], sequence.xyxy[columns])
            i, k = np.nonzero(overlap >= settings.overlap)
            cost = -np.log(overlap[i, k].astype(np.float64)) + settings.gap_cost * (other - frame - 1)
            parts.append((rows[i], columns[k], cost))
    none = np.zeros(0, np.int64)
    if not parts:
        return none, none, np.zeros(0)
    return (
        np.concatenate([part[0] for part in parts]),
        np.concatenate([part[1] for part in parts]),
        np.concatenate([part[2] for part in parts]),
    )


def _chosen_links(
    sequence: DetectedSequence,
    settings: FlowSettings,
    earlier: NDArray[np.int64],
    later: NDArray[np.int64],
    link_cost: NDArray[np.float64],
) -> tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]:
    """Which rows are in a track (R,) bool, and the pairs of rows that follow each other, (M,) and (M,)."""
    from ortools.graph.python import min_cost_flow

    count = len(sequence)
    rows = np.arange(count)
    entry, exit_, source, sink = rows, count + rows, 2 * count, 2 * count + 1
    score = np.clip(sequence.scores.astype(np.float64), 1 - settings.certainty, settings.certainty)
    ends = np.full(count, settings.end_cost)
    tails = [entry, np.full(count, source), exit_, exit_[earlier], np.array([source])]
    heads = [exit_, entry, np.full(count, sink), later, np.array([sink])]
    costs = [-np.log(score / (1 - score)), ends, ends, link_cost, np.zeros(1)]
    capacities = np.ones(3 * count + len(earlier) + 1, np.int64)
    capacities[-1] = count  # what is no track goes past
    flow = min_cost_flow.SimpleMinCostFlow()
    arcs = flow.add_arcs_with_capacity_and_unit_cost(
        np.concatenate(tails).astype(np.int32),
        np.concatenate(heads).astype(np.int32),
        capacities,
        np.rint(np.concatenate(costs) * _SCALE).astype(np.int64),
    )
    flow.set_node_supply(source, count)
    flow.set_node_supply(sink, -count)
    status = flow.solve()
    assert status == flow.OPTIMAL, status  # everything may go past, so there is a solution
    used = np.asarray(flow.flows(arcs)) > 0
    is_link = used[3 * count : 3 * count + len(earlier)]
    return used[:count], earlier[is_link], later[is_link]


def _ids(count: int, chosen: tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]) -> NDArray[np.int64]:
    is_used, earlier, later = chosen
    before = np.full(count, -1, np.int64)
    before[later] = earlier
    ids = np.full(count, -1, np.int64)
    tracks = 0
    for row in np.flatnonzero(is_used).tolist():  # a row comes after the one that it follows
        if before[row] >= 0:
            ids[row] = ids[before[row]]
        else:
            tracks += 1
            ids[row] = tracks
    return ids
