"""Stills with YOLO text files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.errors import OutputError
from lookonce.synthetic.replacing import claim
from lookonce.synthetic.scene import SyntheticFrame, SyntheticScene

__all__ = ["YoloWriter"]


class YoloWriter:
    """Writes OUT/images/NAME-000001.jpg, OUT/labels/NAME-000001.txt and OUT/classes.txt."""

    def __init__(self, scene: SyntheticScene, out: Path, name: str, min_visibility: float, *, overwrite: bool) -> None:
        self.path = out
        self._name, self._size, self._min_visibility = name, scene.size, min_visibility
        claim(out / "images", f"{name}-*.jpg", overwrite=overwrite)
        claim(out / "labels", f"{name}-*.txt", overwrite=overwrite)
        names = "".join(f"{name}\n" for name in scene.classes)
        path = out / "classes.txt"
        if path.exists() and path.read_text() != names:
            raise OutputError(f"{path} names other classes than a synthetic scene has; choose another folder")
        path.write_text(names)

    def write(self, frame: SyntheticFrame, jpeg: Callable[[Path], None]) -> tuple[NDArray[np.int64], dict[str, int]]:
        """The labels, then the picture; what can hardly be seen gets no label."""
        objects = frame.objects
        is_seen = objects.visibility >= self._min_visibility
        kept = objects[is_seen]
        stem = f"{self._name}-{frame.index + 1:06d}"
        height, width = self._size
        xyxy = kept.xyxy.astype(np.float64) / np.array([width, height, width, height])
        middles, sizes = (xyxy[:, :2] + xyxy[:, 2:]) / 2, xyxy[:, 2:] - xyxy[:, :2]
        text = "".join(
            f"{label} {x:.7f} {y:.7f} {w:.7f} {h:.7f}\n"
            for label, (x, y), (w, h) in zip(kept.labels.tolist(), middles.tolist(), sizes.tolist(), strict=True)
        )
        (self.path / "labels" / f"{stem}.txt").write_text(text)
        jpeg(self.path / "images" / f"{stem}.jpg")
        omitted = int((~is_seen).sum())
        return kept.identities, {f"less than {self._min_visibility:.0%} visible": omitted} if omitted else {}

    def close(self) -> None:
        """Nothing is left to do."""
