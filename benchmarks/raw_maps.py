"""Largest difference of a network's raw maps: PyTorch against OpenCV's Darknet importer, ONNX Runtime against PyTorch.

    python benchmarks/raw_maps.py

For every `.cfg` in the data folder: the real weights where they lie beside it, seeded random ones elsewhere.
Differences are relative to the range of the map compared with. The input is random; `--size` sets its size.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray

from lookonce.make.darknet.cfg import read_cfg
from lookonce.make.darknet.importer import import_darknet
from lookonce.make.darknet.layers import DarknetConfig
from lookonce.make.darknet.network import DarknetNetwork
from lookonce.make.darknet.weights import read_weights
from machine import describe_machine

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from darknet_files import write_random_weights  # noqa: E402
from opencv_oracle import opencv_raw_maps  # noqa: E402

QUIET = 3  # ONNX Runtime's log level: errors only


def torch_maps(config: DarknetConfig, weights: Path, images: NDArray[np.uint8]) -> list[NDArray[np.float32]]:
    """Raw maps (B, C, h, w) of images (B, H, W, 3), layer by layer, batch norm unfused."""
    network = DarknetNetwork(config).eval()
    network.load_weights_(read_weights(weights, config)[0])
    with torch.no_grad():
        planes = torch.from_numpy(images).permute(0, 3, 1, 2).to(torch.float32) / 255
        return [raw.numpy() for raw in network(planes)[0]]


def onnx_maps(model_file: Path, config: DarknetConfig, images: NDArray[np.uint8]) -> list[NDArray[np.float32]]:
    """The same from a model file, with the raw maps declared as outputs."""
    model = onnx.load(model_file)
    names = [f"layer_{output.index - 1}" for output in config.outputs]
    for name in names:
        model.graph.output.append(onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None))
    options = onnxruntime.SessionOptions()
    options.log_severity_level = QUIET
    return list(onnxruntime.InferenceSession(model.SerializeToString(), options).run(names, {"images": images}))


def difference(ours: list[NDArray[np.float32]], theirs: list[NDArray[np.float32]]) -> float:
    """Largest absolute difference of any map, relative to its range."""
    return max(float(np.abs(a - b).max() / np.ptp(b)) for a, b in zip(ours, theirs, strict=True))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--size", type=int, default=320)
    arguments = parser.parse_args()
    print(describe_machine())
    print(f"{'network':30} {'weights':8} {'torch - OpenCV':>15} {'ORT - torch':>12}")
    images = np.random.default_rng(0).integers(0, 256, (1, arguments.size, arguments.size, 3), dtype=np.uint8)
    for cfg in sorted(arguments.data.glob("weights/*.cfg")) + sorted(arguments.data.glob("cfg/*.cfg")):
        config = read_cfg(cfg, (arguments.size, arguments.size))
        with tempfile.TemporaryDirectory() as folder:
            weights = cfg.with_suffix(".weights")
            is_real = weights.exists()
            if not is_real:
                weights = Path(folder) / "random.weights"
                write_random_weights(weights, config)
            ours = torch_maps(config, weights, images)
            planes = images.transpose(0, 3, 1, 2).astype(np.float32) / 255
            opencv = difference(ours, opencv_raw_maps(cfg, weights, config, planes))
            import_darknet(cfg, weights, Path(folder) / "model.onnx", size=config.size)
            runtime = difference(onnx_maps(Path(folder) / "model.onnx", config, images), ours)
        print(f"{cfg.stem:30} {'real' if is_real else 'random':8} {opencv:15.1e} {runtime:12.1e}", flush=True)


if __name__ == "__main__":
    main()
