"""Runs model files in bare ONNX Runtime, without the package's own reader, and looks at tensors inside them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch

from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.network import DarknetNetwork
from lookonce.make.darknet.weights import read_weights

OUTPUTS = ("image_index", "boxes", "scores", "labels", "descriptors")


def random_pictures(size: tuple[int, int], count: int = 1, seed: int = 5) -> np.ndarray:
    """(B, H, W, 3) uint8."""
    return np.random.default_rng(seed).integers(0, 256, (count, *size, 3), dtype=np.uint8)


def run_file(
    path: Path,
    pictures: np.ndarray,
    *,
    threads: int = 1,
    inner: Sequence[str] = (),
    score_threshold: float | None = None,
    iou_threshold: float | None = None,
    max_detections: int | None = None,
) -> dict[str, np.ndarray]:
    """The model file's outputs by name, and the tensors named in ``inner``; thresholds left out are the file's own."""
    source: str | bytes = str(path)
    if inner:
        model = onnx.load(path)
        model.graph.output.extend(onnx.helper.make_empty_tensor_value_info(name) for name in inner)
        source = model.SerializeToString()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])
    feed = {"images": pictures}
    if score_threshold is not None:
        feed["score_threshold"] = np.array(score_threshold, np.float32)
    if iou_threshold is not None:
        feed["iou_threshold"] = np.array(iou_threshold, np.float32)
    if max_detections is not None:
        feed["max_detections"] = np.array(max_detections, np.int64)
    names = [output.name for output in session.get_outputs()]
    return dict(zip(names, session.run(names, feed), strict=True))


@torch.no_grad()
def torch_maps(
    cfg: Path, weights: Path, pictures: np.ndarray, size: tuple[int, int] | None = None, features: Sequence[int] = ()
) -> tuple[list[np.ndarray], dict[int, np.ndarray]]:
    """Raw maps and features of the network in PyTorch, batch norm and all."""
    network = DarknetNetwork(read_cfg(cfg, size), features).eval()
    network.load_weights_(read_weights(weights, network.config)[0])
    planes = torch.from_numpy(pictures).permute(0, 3, 1, 2).to(torch.float32) / 255
    raw, found = network(planes)
    return [r.numpy() for r in raw], {index: f.numpy() for index, f in found.items()}
