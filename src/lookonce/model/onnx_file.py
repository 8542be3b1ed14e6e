"""Looks into an ONNX file without running it: its metadata, and whether it keeps data in other files.

An ONNX file is a protobuf message. Only the few fields that lead to metadata and tensors are followed; field numbers
are those of onnx.proto3 (IR version 10). The reading is bounded: lengths and depth are checked before they are used.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator, Mapping
from pathlib import Path

from lookonce.errors import ModelError

__all__ = ["read_metadata"]

MAX_FILE_BYTES = 2 << 30  # protobuf's own limit
_MAX_DEPTH = 40
_MAX_FIELDS = 2_000_000  # the largest official network has some 20,000
_MAX_METADATA_BYTES = 4 << 20
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5

# message -> field number -> the message in that field
_TENSOR_PATHS: Mapping[str, Mapping[int, str]] = {
    "Model": {7: "Graph", 20: "Training", 25: "Function"},
    "Training": {1: "Graph", 2: "Graph"},
    "Function": {7: "Node", 11: "Attribute"},
    "Graph": {1: "Node", 5: "Tensor", 15: "SparseTensor"},
    "Node": {5: "Attribute"},
    "Attribute": {5: "Tensor", 6: "Graph", 10: "Tensor", 11: "Graph", 22: "SparseTensor", 23: "SparseTensor"},
    "SparseTensor": {1: "Tensor", 2: "Tensor"},
    "Tensor": {},
}
_MODEL_METADATA = 14
_TENSOR_EXTERNAL_DATA, _TENSOR_DATA_LOCATION = 13, 14


class _Damaged(Exception):
    """The bytes are not a protobuf message of the expected kind."""


def read_metadata(path: Path) -> dict[str, str]:
    """The ``metadata_props`` of an ONNX file whose tensors all lie inside it.

    Raises:
        ModelError: the file is missing, too large, not ONNX, or refers to external data.
    """
    try:
        size = path.stat().st_size
        if path.is_dir() or size > MAX_FILE_BYTES:
            raise ModelError(f"{path}: not a model file (a folder, or larger than 2 GiB)")
        if size == 0:
            raise ModelError(f"{path}: the file is empty; make it again with 'lookonce import'")
        with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as view:
            buffer = memoryview(view)
            try:
                return _read_model(path, buffer)
            finally:
                buffer.release()
    except OSError as exc:
        raise ModelError(f"{path}: cannot read the model file ({exc.strerror}); check the path") from exc
    except _Damaged as exc:
        raise ModelError(f"{path}: not an ONNX file, or cut short; make it again with 'lookonce import'") from exc


def _read_model(path: Path, buffer: memoryview) -> dict[str, str]:
    pending: list[tuple[str, int, int, int]] = [("Model", 0, len(buffer), 0)]
    metadata: dict[str, str] = {}
    fields = 0
    while pending:
        message, start, end, depth = pending.pop()
        if depth > _MAX_DEPTH:
            raise _Damaged
        paths = _TENSOR_PATHS[message]
        for number, value, first, last in _fields(buffer, start, end):
            fields += 1
            if fields > _MAX_FIELDS:
                raise _Damaged
            if message == "Tensor" and _is_external(number, value):
                raise ModelError(f"{path}: keeps weights in other files, which lookonce refuses; save it as one file")
            if message == "Model" and number == _MODEL_METADATA and first is not None:
                key, text = _key_and_value(buffer, first, last)
                metadata[key] = text
            elif number in paths:
                if first is None:
                    raise _Damaged
                pending.append((paths[number], first, last, depth + 1))
    if fields == 0:
        raise _Damaged
    return metadata


def _is_external(number: int, value: int) -> bool:
    return number == _TENSOR_EXTERNAL_DATA or (number == _TENSOR_DATA_LOCATION and value == 1)


def _key_and_value(buffer: memoryview, start: int, end: int) -> tuple[str, str]:
    """A StringStringEntryProto: key = field 1, value = field 2."""
    texts = {1: "", 2: ""}
    if end - start > _MAX_METADATA_BYTES:
        raise _Damaged
    for number, _, first, last in _fields(buffer, start, end):
        if number in texts and first is not None:
            try:
                texts[number] = bytes(buffer[first:last]).decode("utf-8")
            except UnicodeDecodeError as exc:
                raise _Damaged from exc
    return texts[1], texts[2]


def _fields(buffer: memoryview, start: int, end: int) -> Iterator[tuple[int, int, int | None, int]]:
    """Each field of a message: number, integer value, and for bytes where they begin and end."""
    position = start
    while position < end:
        tag, position = _varint(buffer, position, end)
        number, wire_type = tag >> 3, tag & 7
        value, first, last = 0, None, 0
        if wire_type == _VARINT:
            value, position = _varint(buffer, position, end)
        elif wire_type == _BYTES:
            length, first = _varint(buffer, position, end)
            position = last = first + length
        elif wire_type in (_FIXED64, _FIXED32):
            position += 8 if wire_type == _FIXED64 else 4
        else:
            raise _Damaged
        if position > end or number == 0:
            raise _Damaged
        yield number, value, first, last


def _varint(buffer: memoryview, position: int, end: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if position >= end:
            raise _Damaged
        byte = buffer[position]
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, position
    raise _Damaged
