"""MOTChallenge folders; the layout's class names are those of gt/labels.txt, as CVAT writes them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import xyxy_to_ltwh
from lookonce.synthetic.replacing import claim
from lookonce.synthetic.scene import SyntheticFrame, SyntheticScene

__all__ = ["MotWriter"]


class MotWriter:
    """Writes OUT/NAME: img1/000001.jpg, gt/gt.txt, gt/labels.txt, ignore.txt, seqinfo.ini."""

    def __init__(self, scene: SyntheticScene, out: Path, name: str, *, overwrite: bool) -> None:
        self.path = out / name
        claim(self.path / "img1", "*.jpg", overwrite=overwrite)
        claim(self.path / "gt", "gt.txt", overwrite=overwrite)
        (self.path / "gt" / "labels.txt").write_text("".join(f"{name}\n" for name in scene.classes))
        regions = xyxy_to_ltwh(scene.ignored).tolist()
        (self.path / "ignore.txt").unlink(missing_ok=True)
        if regions:
            (self.path / "ignore.txt").write_text("".join(f"{x:g},{y:g},{w:g},{h:g}\n" for x, y, w, h in regions))
        height, width = scene.size
        (self.path / "seqinfo.ini").write_text(
            f"[Sequence]\nname={name}\nimDir=img1\nframeRate={scene.fps:g}\nseqLength={len(scene)}\n"
            f"imWidth={width}\nimHeight={height}\nimExt=.jpg\n"
        )
        (self.path / "gt" / "gt.txt").touch()

    def write(self, frame: SyntheticFrame, jpeg: Callable[[Path], None]) -> tuple[NDArray[np.int64], dict[str, int]]:
        """The picture, then its rows: frame, id, left, top, width, height, considered, class, visibility."""
        jpeg(self.path / "img1" / f"{frame.index + 1:06d}.jpg")
        objects = frame.objects
        rows = zip(
            objects.identities.tolist(),
            xyxy_to_ltwh(objects.xyxy.astype(np.float64)).tolist(),
            objects.labels.tolist(),
            objects.visibility.tolist(),
            strict=True,
        )
        text = "".join(
            f"{frame.index + 1},{identity},{x:.2f},{y:.2f},{w:.2f},{h:.2f},1,{label + 1},{visibility:.4f}\n"
            for identity, (x, y, w, h), label, visibility in rows
        )
        with (self.path / "gt" / "gt.txt").open("a", encoding="utf-8", newline="\n") as file:
            file.write(text)
        return objects.identities, {}

    def close(self) -> None:
        """Nothing is left to do."""
