"""UA-DETRAC's folders and annotation XML."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.boxes import xyxy_to_ltwh
from lookonce.synthetic.fleet import UA_DETRAC_TYPES
from lookonce.synthetic.replacing import claim
from lookonce.synthetic.scene import SyntheticFrame, SyntheticScene

__all__ = ["DetracWriter"]

_NO_CLASS = "not a vehicle of UA-DETRAC"
_VANS = ("van", "minibus")
_LENGTH = re.compile(r'trajectory_length="@(\d+)"')


class DetracWriter:
    """Writes Insight-MVT_Annotation_Train/NAME/img00001.jpg and DETRAC-Train-Annotations-XML/NAME.xml, or Test."""

    def __init__(self, scene: SyntheticScene, out: Path, name: str, part: str, *, overwrite: bool) -> None:
        part = part.capitalize()
        self._pictures = out / f"Insight-MVT_Annotation_{part}" / name
        self.path = out / f"DETRAC-{part}-Annotations-XML" / f"{name}.xml"
        claim(self._pictures, "img*.jpg", overwrite=overwrite)
        claim(self.path.parent, self.path.name, overwrite=overwrite)
        self._draft = self.path.with_suffix(".part")
        self._classes = scene.classes
        self._lengths: Counter[int] = Counter()
        weather = {"day": "sunny", "night": "night", "change": "cloudy"}[scene.config.light]
        state = "unstable" if scene.config.shake_px else "stable"
        regions = "".join(
            f'      <box left="{x:g}" top="{y:g}" width="{w:g}" height="{h:g}"/>\n'
            for x, y, w, h in xyxy_to_ltwh(scene.ignored).tolist()
        )
        self._draft.write_text(
            f'<?xml version="1.0" encoding="utf-8"?>\n<sequence name="{name}">\n'
            f'   <sequence_attribute camera_state="{state}" sence_weather="{weather}"/>\n'
            f"   <ignored_region>\n{regions}   </ignored_region>\n"
        )

    def write(self, frame: SyntheticFrame, jpeg: Callable[[Path], None]) -> tuple[NDArray[np.int64], dict[str, int]]:
        """The picture, then its rows; people and two-wheelers have no class there."""
        jpeg(self._pictures / f"img{frame.index + 1:05d}.jpg")
        types = [UA_DETRAC_TYPES.get(self._classes[label]) for label in frame.objects.labels.tolist()]
        rows = [row for row, kind in enumerate(types) if kind is not None]
        kept = frame.objects.identities[rows]
        self._lengths.update(kept.tolist())
        targets = "".join(self._target(frame, row, str(types[row])) for row in rows)
        text = f'   <frame density="{len(rows)}" num="{frame.index + 1}">\n'
        text += f"      <target_list>\n{targets}      </target_list>\n   </frame>\n"
        with self._draft.open("a", encoding="utf-8", newline="\n") as file:
            file.write(text)
        omitted = len(types) - len(rows)
        return kept, {_NO_CLASS: omitted} if omitted else {}

    @staticmethod
    def _target(frame: SyntheticFrame, row: int, kind: str) -> str:
        truth = frame.truth
        left, top, right, bottom = truth.objects.xyxy[row].astype(np.float64).tolist()
        kind = "van" if truth.kinds[row] in _VANS else kind
        identity = int(truth.objects.identities[row])
        width, height = round(right - left, 3), round(bottom - top, 3)
        occlusion = ""
        hidden = 1 - float(truth.objects.visibility[row])
        if hidden > 0:
            x, y, w, h = _hidden_box((left, top, width, height), truth.hidden[row], hidden)
            by = int(truth.hidden_by[row])
            occlusion = (
                f'            <occlusion>\n               <region_overlap left="{x:.3f}" top="{y:.3f}" width="{w:.4f}" '
                f'height="{h:.4f}" occlusion_id="{by}" occlusion_status="{1 if by < 0 else 0}"/>\n'
                "            </occlusion>\n"
            )
        return (
            f'         <target id="{identity}">\n'
            f'            <box left="{left:.3f}" top="{top:.3f}" width="{width:.3f}" height="{height:.3f}"/>\n'
            f'            <attribute orientation="{truth.heading_deg[row]:.3f}" speed="{truth.speed_m_s[row]:.4f}" '
            f'trajectory_length="@{identity}" truncation_ratio="{truth.truncation[row]:.4f}" vehicle_type="{kind}"/>\n'
            f"{occlusion}         </target>\n"
        )

    def close(self) -> None:
        """Puts the lengths of the tracks in, and gives the XML its name."""
        whole = self.path.with_suffix(".whole")
        with self._draft.open(encoding="utf-8") as source, whole.open("w", encoding="utf-8", newline="\n") as target:
            for text in source:
                target.write(_LENGTH.sub(lambda found: f'trajectory_length="{self._lengths[int(found[1])]}"', text))
            target.write("</sequence>\n")
        whole.replace(self.path)
        self._draft.unlink()


def _hidden_box(
    ltwh: tuple[float, float, float, float], hidden: NDArray[np.float32], share: float
) -> tuple[float, float, float, float]:
    """A rectangle in a box ``ltwh`` around the hidden pixels' middle, whose area is that share of the box's."""
    left, top, width, height = ltwh
    x0, y0, x1, y1 = hidden.astype(np.float64).tolist()
    wide, high = max(x1 - x0, 1e-3), max(y1 - y0, 1e-3)
    area = share * width * height
    w = min(width, max(wide * (area / (wide * high)) ** 0.5, area / height))
    h = min(height, area / w)
    x = min(max((x0 + x1 - w) / 2, left), left + width - w)
    y = min(max((y0 + y1 - h) / 2, top), top + height - h)
    return x, y, w, h
