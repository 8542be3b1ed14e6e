"""A labelled sequence as a camera would see it that pans over it: a window into its pictures that wanders.

    python benchmarks/panned.py PETS09-S2L1 panned
    lookonce compare --truth panned -m street --classes person --every 1,2,4

Real pictures with identity truth and a moving camera of known path are rare. The window is two thirds as wide and as
high as the picture and wanders by sines of two periods, from border to border. Truth is cut at its border; a box of
which less than 40 % of the width or of the height is left is not truth. Reads and writes MOTChallenge sequences; every
row of the truth counts.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from PIL import Image

PERIODS_S = (8.0, 11.0)
LEAST_LEFT = 0.4
TRUTH = "gt/gt.txt"
QUALITY = 92


def corner(time_s: float, room: tuple[int, int]) -> tuple[int, int]:
    """Left and top of the window, px, of so much room across and down."""
    across, down = (
        0.5 + 0.47 * math.sin(2 * math.pi * time_s / period + phase) for phase, period in enumerate(PERIODS_S)
    )
    return round(across * room[0]), round(down * room[1])


def main() -> None:
    """Write the sequence."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequence", type=Path, help="with pictures and truth, as MOTChallenge lays them out")
    parser.add_argument("output", type=Path, help="folder to make")
    parser.add_argument("--fps", type=float, default=7.0)
    parser.add_argument("--frames", type=int, default=400)
    arguments = parser.parse_args()
    pictures, truth = sorted((arguments.sequence / "img1").glob("*.*"))[: arguments.frames], arguments.sequence / TRUTH
    if not pictures or not truth.is_file():
        parser.error(f"{arguments.sequence}: expected pictures in img1 and truth in {TRUTH}")
    if arguments.output.exists():
        parser.error(f"{arguments.output}: is there already; name another folder")
    table = np.loadtxt(truth, delimiter=",", ndmin=2)
    for part in ("img1", "gt"):
        (arguments.output / part).mkdir(parents=True)
    lines = []
    for number, path in enumerate(pictures, 1):
        with Image.open(path) as picture:
            width, height = picture.width * 2 // 3, picture.height * 2 // 3
            left, top = corner((number - 1) / arguments.fps, (picture.width - width, picture.height - height))
            window = picture.crop((left, top, left + width, top + height))
            window.save(arguments.output / "img1" / f"{number:06d}.jpg", quality=QUALITY)
        for _, identity, x, y, w, h in table[table[:, 0] == number, :6]:
            low, high = np.array([x - left, y - top]), np.array([x + w - left, y + h - top])
            low, high = np.maximum(low, 0), np.minimum(high, [width, height])
            if ((high - low) > LEAST_LEFT * np.array([w, h])).all():
                box = ",".join(f"{value:.2f}" for value in (*low, *(high - low)))
                lines.append(f"{number},{identity:.0f},{box},1,1,1\n")
    (arguments.output / TRUTH).write_text("".join(lines))
    (arguments.output / "seqinfo.ini").write_text(
        f"[Sequence]\nname={arguments.output.name}\nimDir=img1\nframeRate={arguments.fps:g}\nseqLength={len(pictures)}\n"
        f"imWidth={width}\nimHeight={height}\nimExt=.jpg\n"
    )
    print(f"{arguments.output}: {len(pictures)} frames of {width} x {height} px, {len(lines)} boxes")


if __name__ == "__main__":
    main()
