"""What every kind of descriptor head offers: a reading of features at each detection, and a network on top of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import onnx_ir as ir

from lookonce.make.export.detections import SelectedDetections
from lookonce.make.export.graph import GraphWriter

__all__ = ["DESCRIPTOR_SIZE", "HeadKind"]

DESCRIPTOR_SIZE = 128  # the paper's


class HeadKind(Protocol):
    """A kind of head, laid out for one detector.

    Attributes:
        name: such as ``compact``.
        layers: names of the features that are read.
    """

    @property
    def name(self) -> str:
        """Such as ``compact``."""
        ...

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the features that are read."""
        ...

    def write_reading(
        self, g: GraphWriter, rows: SelectedDetections, features: Mapping[str, ir.Value]
    ) -> dict[str, ir.Value]:
        """Append the lookup of what training sees at N rows; by name, N values each."""
        ...
