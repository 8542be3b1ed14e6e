"""Writing ONNX operators one by one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import onnx_ir as ir
from numpy.typing import NDArray
from onnx_ir.tape import Tape

__all__ = ["OPSET", "GraphWriter"]

OPSET = 18
_SMALLEST_LENGTH = 1e-12  # below, a vector has no direction: it stays zero


class GraphWriter:
    """Appends operators to a graph: ``writer("Add", a, b)`` gives the new value."""

    def __init__(self, graph: ir.Graph) -> None:
        self.graph = graph
        self._tape = Tape(graph)
        self._taken = set(graph.initializers)  # a reopened graph has constants already
        self._constants = 0

    def __call__(self, op_type: str, *inputs: ir.Value | None, **attributes: Any) -> ir.Value:
        """Append one operator with one output."""
        return self._tape.op(op_type, inputs, attributes)

    def many(self, op_type: str, outputs: int, *inputs: ir.Value | None, **attributes: Any) -> Sequence[ir.Value]:
        """Append one operator with several outputs."""
        return self._tape.op_multi_out(op_type, inputs, attributes, num_outputs=outputs)

    def constant(self, values: NDArray[Any] | Sequence[int] | int | float) -> ir.Value:
        """A constant; plain integers become int64, a plain float becomes float32."""
        array = np.asarray(values)
        if not isinstance(values, np.ndarray):
            array = array.astype(np.float32 if array.dtype.kind == "f" else np.int64)
        self._constants += 1
        while f"constant_{self._constants}" in self._taken:
            self._constants += 1
        return self._tape.initializer(ir.tensor(array, name=f"constant_{self._constants}"))

    def cast(self, value: ir.Value, dtype: ir.DataType) -> ir.Value:
        """The value in another type."""
        return self("Cast", value, to=int(dtype))

    def size(self, value: ir.Value, axis: int) -> ir.Value:
        """(1,) int64: the length of one axis."""
        return self("Shape", value, start=axis, end=axis + 1)

    def unit_length(self, rows: ir.Value) -> ir.Value:
        """Rows (N, C) scaled to unit length; a row of zeros stays."""
        length = self("ReduceL2", rows, self.constant([1]), keepdims=1)
        return self("Div", rows, self("Max", length, self.constant(_SMALLEST_LENGTH)))

    def input_with_default(self, name: str, default: NDArray[Any], doc: str) -> ir.Value:
        """A scalar input that may be left out."""
        value = self._tape.initializer(ir.tensor(default, name=name))
        value.doc_string = doc
        self.graph.inputs.append(value)
        return value

    def output(self, name: str, value: ir.Value, dtype: ir.DataType, shape: Sequence[int | str], doc: str) -> None:
        """Declare ``value`` as an output of the graph."""
        result = self("Identity", value)
        result.name, result.doc_string = name, doc
        result.dtype, result.shape = dtype, ir.Shape(shape)
        self.graph.outputs.append(result)
