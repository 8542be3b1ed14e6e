"""The raw maps of a Darknet network as OpenCV's own importer computes them: an outside opinion."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from lookonce.make.darknet.layers import DarknetConfig


def opencv_raw_maps(cfg: Path, weights: Path, config: DarknetConfig, images: np.ndarray) -> list[np.ndarray]:
    """What enters each output layer, (B, C, h, w) float32, for ``images (B, 3, H, W) float32``.

    Raises:
        cv2.error: OpenCV does not know a layer of the network.
    """
    network = cv2.dnn.readNetFromDarknet(str(cfg), str(weights))
    known = network.getLayerNames()
    names = []
    for output in config.outputs:
        before = output.index - 1
        activated = f"logistic_{output.index}"  # an activation is a layer of its own, numbered one higher
        names.append(activated if activated in known else f"conv_{before}")
    network.setInput(images)
    return list(network.forward(names))
