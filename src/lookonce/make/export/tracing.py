"""Tracing a PyTorch network into a graph to write on: what of this room needs PyTorch."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import onnx_ir as ir
import torch
from torch import Tensor, nn

from lookonce.make.export.graph import OPSET

__all__ = ["trace"]


class _ImagesIn(nn.Module):
    """A network behind the model file's input: uint8 RGB rows to float planes in [0, 1]."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        planes = images.permute(0, 3, 1, 2).to(torch.float32) / 255  # (B, H, W, 3) -> (B, 3, H, W)
        raw, features = self.network(planes)
        return (*raw, *features.values())


def trace(network: nn.Module, size: tuple[int, int], names: Sequence[str]) -> tuple[ir.Model, Mapping[str, ir.Value]]:
    """A network as an ONNX model that takes ``images (B, H, W, 3) uint8``.

    Args:
        network: (B, 3, H, W) float in [0, 1] -> (list of raw maps, dict of features), in evaluation mode.
        size: H, W.
        names: of the raw maps, then the features; the tensors carry them in the graph.

    Returns:
        The model, without outputs yet, and its named tensors.
    """
    example = torch.zeros(
        2, *size, 3, dtype=torch.uint8
    )  # two images: the exporter takes a batch of one for a constant
    with _quiet_exporter():
        program = torch.onnx.export(
            _ImagesIn(network).eval(),
            (example,),
            dynamo=True,
            input_names=["images"],
            output_names=list(names),
            dynamic_shapes={"images": {0: torch.export.Dim("batch")}},
            opset_version=OPSET,
            verbose=False,
        )
    assert program is not None
    model: ir.Model = program.model
    values = {str(value.name): value for value in model.graph.outputs}
    model.graph.outputs.clear()
    for node in model.graph:
        node.metadata_props.clear()  # stack traces of the machine that exported
    return model, values


@contextmanager
def _quiet_exporter() -> Iterator[None]:
    """Silence the exporter's remarks on packages that nobody asked for."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
