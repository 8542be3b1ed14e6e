"""The anchors of all cells of all output grids: where they are, and what box a raw output means there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from lookonce.make.darknet.layers import DarknetConfig, Yolo

__all__ = ["AnchorGrids", "Grid", "decode", "encode"]

_MOST_LOG_SIZE = 6.0  # an anchor grows to 400 times its size at most, so that exp stays finite


@dataclass(frozen=True, slots=True)
class Grid:
    """One output grid.

    Attributes:
        stride_px: px of the input for one cell.
        rows, columns: of cells.
        shapes: (a, 2) float32, width and height of its anchors in px.
        scale_x_y: how far centres may leave their cell (1: not at all).
        first: number of its first anchor.
    """

    stride_px: int
    rows: int
    columns: int
    shapes: Tensor
    scale_x_y: float
    first: int


class AnchorGrids:
    """A anchors in all, numbered by grid, anchor, row, column.

    Attributes:
        grids: in the order of the network's outputs.
        facts: (A, 6) float32: column, row, stride, anchor's width and height in px, scale_x_y.
        classes: C.
    """

    def __init__(self, network: DarknetConfig, device: torch.device) -> None:
        self.classes = network.classes
        self.grids: list[Grid] = []
        facts = []
        first = 0
        for layer in network.outputs:
            spec = layer.spec
            assert isinstance(spec, Yolo)
            shapes = torch.tensor(spec.anchors, dtype=torch.float32)
            anchor, row, column = (
                axis.flatten()
                for axis in torch.meshgrid(
                    torch.arange(len(shapes)), torch.arange(layer.height), torch.arange(layer.width), indexing="ij"
                )
            )
            same = torch.ones(len(anchor))
            stride = network.stride(layer)
            facts.append(
                torch.stack([column * same, row * same, stride * same, *shapes[anchor].T, spec.scale_x_y * same], 1)
            )
            self.grids.append(Grid(stride, layer.height, layer.width, shapes.to(device), spec.scale_x_y, first))
            first += len(anchor)
        self.facts = torch.cat(facts).to(device)

    def __len__(self) -> int:
        return len(self.facts)

    def outputs(self, raw: Sequence[Tensor]) -> Tensor:
        """Raw maps (B, a x (5 + C), h, w) of all grids as (B, A, 5 + C) float32."""
        parts = []
        for one, grid in zip(raw, self.grids, strict=True):
            split = one.float().reshape(len(one), len(grid.shapes), 5 + self.classes, grid.rows * grid.columns)
            parts.append(split.transpose(2, 3).reshape(len(one), -1, 5 + self.classes))
        return torch.cat(parts, 1)


def decode(outputs: Tensor, facts: Tensor) -> Tensor:
    """YOLOv3's equations: raw outputs (N, 4 or more) of anchors with ``facts`` (N, 6) -> xyxy (N, 4) in px."""
    scale = facts[:, 5:6]
    position = torch.sigmoid(outputs[:, :2]) * scale - (scale - 1) / 2
    centre = (position + facts[:, :2]) * facts[:, 2:3]
    half = outputs[:, 2:4].clamp(max=_MOST_LOG_SIZE).exp() * facts[:, 3:5] / 2
    return torch.cat([centre - half, centre + half], 1)


def encode(xyxy: Tensor, facts: Tensor) -> tuple[Tensor, Tensor]:
    """What ``decode`` would have to be given: positions in the cell's range, 0 to 1, and logs of sizes, (N, 2) each."""
    scale = facts[:, 5:6]
    position = (xyxy[:, :2] + xyxy[:, 2:]) / 2 / facts[:, 2:3] - facts[:, :2]
    within = (position + (scale - 1) / 2) / scale
    return within.clamp(0, 1), ((xyxy[:, 2:] - xyxy[:, :2]) / facts[:, 3:5]).clamp(min=1e-4).log()
