"""Tiny labelled data, and what a refusal says."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from PIL import Image

from lookonce.errors import LookonceError

SIZE = (48, 64)


def write(path: Path, text: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def write_picture(path: Path, size: tuple[int, int] = SIZE, **options: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (size[1], size[0])).save(path, **options)
    return path


def write_pictures(folder: Path, names: Iterable[str], size: tuple[int, int] = SIZE) -> Path:
    for name in names:
        write_picture(folder / name, size)
    return folder


def write_mot(folder: Path, truth: str | bytes, *, pictures: int = 3, size: tuple[int, int] = SIZE) -> Path:
    """A sequence in MOTChallenge's layout."""
    write(folder / "gt" / "gt.txt", truth)
    write_pictures(folder / "img1", [f"{n:06d}.png" for n in range(1, pictures + 1)], size)
    return folder


def write_kitti(root: Path, truth: str, *, name: str = "0000", pictures: int = 3, start: int = 0) -> Path:
    """A root in KITTI's layout with one sequence (more)."""
    write(root / "label_02" / f"{name}.txt", truth)
    write_pictures(root / "image_02" / name, [f"{n:06d}.png" for n in range(start, start + pictures)])
    return root


def target(
    identity: object = 1,
    box: str = 'left="10" top="5" width="20" height="10"',
    kind: str = "car",
    overlaps: Iterable[str] = (),
) -> str:
    hidden = "".join(f'<region_overlap {overlap} occlusion_id="5" occlusion_status="1"/>' for overlap in overlaps)
    return (
        f'<target id="{identity}">\n<box {box}/>\n<attribute truncation_ratio="0.5" vehicle_type="{kind}"/>'
        f"{f'<occlusion>{hidden}</occlusion>' if hidden else ''}</target>\n"
    )


def frame(number: object, *targets: str) -> str:
    return f'<frame density="{len(targets)}" num="{number}"><target_list>\n{"".join(targets)}</target_list></frame>\n'


def annotation(*frames: str, name: str = "MVI_1", ignored: Iterable[str] = ()) -> str:
    """A UA-DETRAC annotation."""
    regions = "".join(f"<box {box}/>\n" for box in ignored)
    return (
        f'<?xml version="1.0" encoding="utf-8"?>\n<sequence name="{name}">\n'
        f"<ignored_region>\n{regions}</ignored_region>\n{''.join(frames)}</sequence>\n"
    )


def write_detrac(folder: Path, text: str | bytes, *, name: str = "MVI_1", pictures: int = 3) -> Path:
    """A folder with one annotation and its pictures beside it."""
    write(folder / f"{name}.xml", text)
    return write_pictures(folder, [f"img{n:05d}.jpg" for n in range(1, pictures + 1)])


def write_stills(folder: Path, labels: dict[str, str | None], *, size: tuple[int, int] = SIZE) -> Path:
    """A set with ``images`` and ``labels``; a picture with None has no label file."""
    for name, text in labels.items():
        write_picture(folder / "images" / f"{name}.png", size)
        if text is not None:
            write(folder / "labels" / f"{name}.txt", text)
    return folder


def refusal(kind: type[LookonceError], call: Callable[[], object]) -> str:
    """The message of the error that ``call`` raises, which is one line."""
    with pytest.raises(kind) as caught:
        call()
    message = str(caught.value)
    assert message.isprintable(), message
    return message
