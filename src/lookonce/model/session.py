"""ONNX Runtime behind one face: opening with a chosen provider, its errors translated."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray
from onnxruntime.capi import onnxruntime_pybind11_state as native

from lookonce.errors import ConfigError, ModelError

__all__ = ["PROVIDERS", "available_cpus", "open_session", "run_session"]

PROVIDERS = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "openvino": "OpenVINOExecutionProvider",
}
_INSTALL = {"cuda": "onnxruntime-gpu", "openvino": "onnxruntime-openvino"}
_ERRORS: tuple[type[Exception], ...] = tuple(
    c for c in vars(native).values() if isinstance(c, type) and issubclass(c, Exception)
)
_LOADING_ERRORS: tuple[type[Exception], ...] = (
    *_ERRORS,
    ValueError,
    RuntimeError,
)  # ValueError: its message on a damaged name is not UTF-8
_LOG_FATAL_ONLY = 4  # errors come as exceptions, which are told in one line


def available_cpus() -> int:
    """How many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def open_session(path: Path, provider: str, threads: int, content: bytes | None = None) -> Any:
    """An ONNX Runtime session on a checked file.

    Args:
        path: the file, named in messages.
        provider: ``cpu``, ``cuda`` or ``openvino``.
        threads: for one inference.
        content: what to load in place of the file: its graph, changed.

    Raises:
        ConfigError: the provider is unknown or not installed.
        ModelError: ONNX Runtime cannot load the file.
    """
    if provider not in PROVIDERS:
        raise ConfigError(f"provider '{provider}': expected one of {', '.join(PROVIDERS)}")
    installed = onnxruntime.get_available_providers()
    if PROVIDERS[provider] not in installed:
        raise ConfigError(
            f"provider '{provider}' is not in the installed ONNX Runtime; "
            f"pip install {_INSTALL[provider]} in place of onnxruntime"
        )
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = _LOG_FATAL_ONLY
    providers = [PROVIDERS[provider]] + ([PROVIDERS["cpu"]] if provider != "cpu" else [])
    try:
        # Its own fallback would print to stdout and go on with another provider.
        session = onnxruntime.InferenceSession(content or path, options, providers=providers, enable_fallback=0)
    except _LOADING_ERRORS as exc:
        raise ModelError(f"{path}: ONNX Runtime cannot load it ({_first_line(exc)})") from exc
    if session.get_providers()[0] != PROVIDERS[provider]:
        raise ConfigError(
            f"provider '{provider}' is installed but does not start here; is there a device and a driver?"
        )
    return session


def run_session(path: Path, session: Any, feed: dict[str, NDArray[Any]], outputs: list[str]) -> list[NDArray[Any]]:
    """One inference.

    Raises:
        ModelError: ONNX Runtime failed, out of memory included.
    """
    try:
        results: list[NDArray[Any]] = session.run(outputs, feed)
    except _ERRORS as exc:
        raise ModelError(f"{path}: ONNX Runtime failed ({_first_line(exc)})") from exc
    return [np.asarray(result) for result in results]


def _first_line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return text[0][:200] if text else type(error).__name__
