"""A clip in another size, made on the spot."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av


def parse_size(text: str) -> tuple[int, int]:
    """(height, width) in px of ``WIDTHxHEIGHT``, as videos are named."""
    width, _, height = text.partition("x")
    return int(height), int(width)


def rescale(video: Path, target: Path, size: tuple[int, int], frames: int) -> Path:
    """The first ``frames`` of a video as H.264 of ``size`` (height, width); a shorter video is repeated."""
    with av.open(str(target), "w") as output:
        stream = output.add_stream("libx264", rate=25, options={"preset": "medium", "crf": "23"})
        stream.height, stream.width, stream.pix_fmt = *size, "yuv420p"
        written = 0
        while written < frames:
            with av.open(str(video)) as source:
                for frame in source.decode(video=0):
                    scaled = frame.reformat(width=size[1], height=size[0], format="yuv420p", interpolation="BICUBIC")
                    scaled.pts, scaled.time_base = written, Fraction(1, 25)
                    output.mux(stream.encode(scaled))
                    written += 1
                    if written == frames:
                        break
        output.mux(stream.encode(None))
    return target
