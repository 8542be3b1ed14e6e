"""CPU time of several ways from a decoded frame to the detector's input, on one thread.

    python benchmarks/letterbox.py VIDEO --scale 960x540 --sizes 416 512

    yuv        lookonce's Letterboxer on the decoder's frame: libswscale, straight from the YUV planes
    rgb        lookonce's Letterboxer on an RGB array that is there already
    cv2-yuv    the frame converted to RGB by PyAV, then OpenCV's resize into a canvas that is kept
    cv2-rgb    OpenCV's resize of an RGB array that is there already, into a canvas that is kept
    yuv-...    libswscale straight from the YUV planes with another filter than the Letterboxer's AREA

All ways take each frame in turn, A B C D A B C D; a time is process CPU time, and a figure the median of the frames of
a round. The ratio is to `cv2-yuv`, which does the same work as `yuv`. The last two columns are the mean absolute
difference of the pixels, 0 to 255, to those of `cv2-rgb` with INTER_LINEAR, and to OpenCV's INTER_AREA.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
from av.video.reformatter import Interpolation, VideoReformatter
from numpy.typing import NDArray

from clips import parse_size, rescale
from lookonce.letterbox import PADDING_GREY, Letterboxer, fit, to_rgb
from machine import describe_machine

WARM_UP_FRAMES = 5
OTHER_FILTERS = (Interpolation.FAST_BILINEAR, Interpolation.BILINEAR, Interpolation.BICUBIC)

Canvas = NDArray[np.uint8]
Way = Callable[[av.VideoFrame, NDArray[np.uint8]], Canvas]


class OpenCvLetterboxer:
    """OpenCV's resize into a kept canvas."""

    def __init__(self, network: tuple[int, int], interpolation: int = cv2.INTER_LINEAR) -> None:
        self._canvas = np.full((*network, 3), PADDING_GREY, np.uint8)
        self._interpolation = interpolation

    def __call__(self, rgb: NDArray[np.uint8]) -> Canvas:
        """The canvas, the same array at each call."""
        placed = fit(rgb.shape[:2], self._canvas.shape[:2])
        (top, left), (height, width) = placed.offset, placed.scaled
        inside = self._canvas[top : top + height, left : left + width]
        cv2.resize(rgb, (width, height), dst=inside, interpolation=self._interpolation)
        return self._canvas


class SwscaleLetterboxer:
    """What ``lookonce.letterbox.Letterboxer`` does with an upright frame, with any of libswscale's filters."""

    def __init__(self, network: tuple[int, int], interpolation: Interpolation) -> None:
        self._network = network
        self._interpolation = interpolation
        self._scaler = VideoReformatter()

    def __call__(self, frame: av.VideoFrame) -> Canvas:
        """A new canvas."""
        placed = fit((frame.height, frame.width), self._network)
        (top, left), (height, width) = placed.offset, placed.scaled
        scaled = self._scaler.reformat(
            frame, width=width, height=height, format="rgb24", interpolation=self._interpolation, threads=1
        )
        canvas = np.full((*self._network, 3), PADDING_GREY, np.uint8)
        canvas[top : top + height, left : left + width] = scaled.to_ndarray()
        return canvas


def make_ways(network: tuple[int, int]) -> dict[str, Way]:
    """The ways by name; each gets the frame and its RGB."""
    from_yuv, from_rgb = Letterboxer(network), Letterboxer(network)
    converted, ready = OpenCvLetterboxer(network), OpenCvLetterboxer(network)
    ways: dict[str, Way] = {
        "yuv": lambda frame, rgb: from_yuv(frame)[0],
        "rgb": lambda frame, rgb: from_rgb(rgb)[0],
        "cv2-yuv": lambda frame, rgb: converted(to_rgb(frame)),
        "cv2-rgb": lambda frame, rgb: ready(rgb),
    }
    for interpolation in OTHER_FILTERS:
        ways[f"yuv-{interpolation.name}"] = _with_filter(SwscaleLetterboxer(network, interpolation))
    return ways


def _with_filter(letterbox: SwscaleLetterboxer) -> Way:
    return lambda frame, rgb: letterbox(frame)


def read_frames(video: Path, count: int) -> list[av.VideoFrame]:
    """The first frames as the decoder gives them."""
    with av.open(str(video)) as container:
        return list(itertools.islice(container.decode(video=0), count))


def measure(ways: dict[str, Way], frames: list[av.VideoFrame], rounds: int) -> NDArray[np.float64]:
    """CPU milliseconds a frame, (rounds, ways)."""
    pictures = [to_rgb(frame) for frame in frames]
    medians = []
    for _ in range(rounds):
        times = np.zeros((len(frames), len(ways)))
        for index, (frame, rgb) in enumerate(zip(frames, pictures, strict=True)):
            for column, way in enumerate(ways.values()):
                start = time.process_time_ns()
                way(frame, rgb)
                times[index, column] = time.process_time_ns() - start
        medians.append(np.median(times[WARM_UP_FRAMES:], axis=0) / 1e6)
    return np.array(medians)


def pixel_difference(
    ways: dict[str, Way], frames: list[av.VideoFrame], network: tuple[int, int]
) -> dict[str, list[float]]:
    """Mean absolute difference of each way's picture, without the grey, to OpenCV's INTER_LINEAR and INTER_AREA."""
    references = [OpenCvLetterboxer(network, kind) for kind in (cv2.INTER_LINEAR, cv2.INTER_AREA)]
    placed = fit((frames[0].height, frames[0].width), network)
    (top, left), (height, width) = placed.offset, placed.scaled
    inside = np.s_[top : top + height, left : left + width]
    sums = {name: np.zeros(2) for name in ways}
    for frame in frames:
        rgb = to_rgb(frame)
        wanted = [reference(rgb)[inside].astype(np.float32) for reference in references]
        for name, way in ways.items():
            pixels = way(frame, rgb)[inside]
            sums[name] += [np.abs(pixels - picture).mean() for picture in wanted]
    return {name: (total / len(frames)).tolist() for name, total in sums.items()}


def print_table(frames: list[av.VideoFrame], size: int, rounds: int) -> None:
    """One network size."""
    ways = make_ways((size, size))
    times = measure(ways, frames, rounds)
    apart = pixel_difference(ways, frames[::10], (size, size))
    ratios = times / times[:, [list(ways).index("cv2-yuv")]]
    print(f"\n{frames[0].width}x{frames[0].height} {frames[0].format.name} -> {size}")
    print(f"{'way':<18} {'CPU ms':>8} {'ratio':>7}   {'ratios of the rounds':<{6 * rounds}} {'linear':>8} {'area':>8}")
    for column, name in enumerate(ways):
        each = " ".join(f"{ratio:5.2f}" for ratio in ratios[:, column])
        linear, area = apart[name]
        print(
            f"{name:<18} {np.median(times[:, column]):8.3f} {np.median(ratios[:, column]):7.2f}   "
            f"{each:<{6 * rounds}} {linear:8.3f} {area:8.3f}",
            flush=True,
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("video", type=Path)
    parser.add_argument("--scale", type=parse_size, metavar="WIDTHxHEIGHT", help="make the video this large first")
    parser.add_argument("--sizes", type=int, nargs="+", default=[416, 512])
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    print(describe_machine())
    print(f"{arguments.video.name}, {arguments.frames} frames, {arguments.rounds} rounds")
    with tempfile.TemporaryDirectory() as folder:
        video = arguments.video
        if arguments.scale:
            video = rescale(video, Path(folder) / "scaled.mp4", arguments.scale, arguments.frames)
        frames = read_frames(video, arguments.frames)
    for size in arguments.sizes:
        print_table(frames, size, arguments.rounds)


if __name__ == "__main__":
    main()
