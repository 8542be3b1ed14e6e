"""Graphs of a few operators on given arrays, and descriptions of detectors that need no network."""

from __future__ import annotations

import numpy as np
import onnx_ir as ir
import onnxruntime
import pytest
import torch
from torch import nn

from lookonce.make.descriptors.compact import CompactHead, CompactKind
from lookonce.make.descriptors.paper import PaperHead
from lookonce.make.export.detections import SelectedDetections
from lookonce.make.export.graph import OPSET, GraphWriter
from lookonce.model.metadata import Feature, ModelMetadata, OutputGrid

_DTYPES = {"float32": ir.DataType.FLOAT, "int64": ir.DataType.INT64}


@pytest.fixture(autouse=True)
def _one_thread():
    """Networks as small as these are slower on several threads, and very slow where other programs hold the cores."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="session")
def run_graph():
    """``run_graph(write, arrays, threads)``: what ``write(g, values)`` names, computed by ONNX Runtime."""

    def run(write, arrays, threads=1):
        inputs = {
            name: ir.Value(
                name=f"given_{name}", type=ir.TensorType(_DTYPES[str(a.dtype)]), shape=ir.Shape([None] * a.ndim)
            )
            for name, a in arrays.items()
        }
        graph = ir.Graph(list(inputs.values()), [], nodes=[], opset_imports={"": OPSET}, name="test")
        g = GraphWriter(graph)
        outputs = {name: g("Identity", value) for name, value in write(g, inputs).items()}
        for name, value in outputs.items():
            value.name = name
            graph.outputs.append(value)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        content = ir.to_proto(ir.Model(graph, ir_version=10)).SerializeToString()
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        names = list(outputs)
        feed = {f"given_{name}": array for name, array in arrays.items()}
        return dict(zip(names, session.run(names, feed), strict=True))

    return run


@pytest.fixture(scope="session")
def run_reading(run_graph):
    """``run_reading(kind, rows, maps)``: the reading of a kind of head at given rows of given maps."""

    def run(kind, rows, maps):
        def write(g, values):
            return kind.write_reading(g, SelectedDetections(**{name: values[name] for name in rows}), values)

        return run_graph(write, rows | maps)

    return run


@pytest.fixture(scope="session")
def run_head(run_graph):
    """``run_head(head, rows, maps)``: the descriptors that a head's graph makes at given rows of given maps."""

    def run(head, rows, maps, threads=1):
        def write(g, values):
            selected = SelectedDetections(**{name: values[name] for name in rows})
            return {"descriptors": head.write(g, selected, values)}

        return run_graph(write, rows | maps, threads)["descriptors"]

    return run


@pytest.fixture(scope="session")
def describe():
    """``describe(features, grids)`` of features (name, channels, stride), grids (stride, anchors, near, early)."""

    def make(features, grids, size=(64, 96), names=("thing",)):
        outputs = [OutputGrid(stride, tuple(anchors), near, early) for stride, anchors, near, early in grids]
        return ModelMetadata(names, size, tuple(outputs), features=tuple(Feature(*f) for f in features))

    return make


@pytest.fixture(scope="session")
def random_maps():
    """``random_maps(metadata, batch)``: a random map for each feature of a description."""

    def make(metadata, batch=1, seed=3):
        rng = np.random.default_rng(seed)
        height, width = metadata.size
        return {
            f.name: rng.normal(size=(batch, f.channels, height // f.stride_px, width // f.stride_px)).astype(np.float32)
            for f in metadata.features
        }

    return make


@pytest.fixture(scope="session")
def random_head():
    """``random_head(kind)``: a head with random weights, in evaluation; its batch norms have seen something."""

    def make(kind, seed=1, embedding=48, gate=16):
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            if isinstance(kind, CompactKind):
                channels = sum(kind.channels)
                mean, spread = torch.randn(channels).numpy(), torch.rand(channels).numpy() + 0.5
                return CompactHead(kind, mean, spread, embedding, gate).eval()
            head = PaperHead(kind)
            for module in head.modules():
                if isinstance(module, nn.BatchNorm2d):
                    nn.init.normal_(module.running_mean, std=0.2)
                    nn.init.uniform_(module.running_var, 0.5, 1.5)
                    nn.init.uniform_(module.weight, 0.5, 1.5)
                    nn.init.normal_(module.bias, std=0.2)
        return head.eval()

    return make
