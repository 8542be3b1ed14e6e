"""Small videos and pictures whose grey level says which frame it is."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from PIL import Image

from lookonce.video import Frame

DATA = Path(__file__).parents[2].parent / "shared" / "data"
STEP = 4  # grey levels between one frame and the next; coding moves them by less


def grey(number: int, size: tuple[int, int] = (48, 64)) -> np.ndarray:
    return np.full((*size, 3), 20 + STEP * number, np.uint8)


def number_in(frame: Frame) -> int:
    return round((float(frame.image.mean()) - 20) / STEP)


def numbers_in(source) -> list[int]:
    return [number_in(frame) for frame in source]


def write_clip(
    path: Path,
    count: int = 20,
    *,
    times_s: Sequence[float] | None = None,
    images: Sequence[np.ndarray] | None = None,
    codec: str = "libx264",
    b_frames: int = 0,
    key_every: int = 5,
    matrix: list[int] | None = None,
    options: dict[str, str] | None = None,
) -> Path:
    """At 10 frames per second unless ``times_s`` says otherwise."""
    images = [grey(i) for i in range(count)] if images is None else images
    times_s = [i / 10 for i in range(len(images))] if times_s is None else times_s
    with av.open(str(path), "w", options=options or {}) as container:
        stream = container.add_stream(codec, rate=10)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        stream.codec_context.bit_rate = 4_000_000  # for the codecs that need to be told to be exact
        stream.codec_context.gop_size = key_every
        stream.codec_context.max_b_frames = b_frames
        stream.codec_context.time_base = Fraction(1, 10 if path.suffix == ".avi" else 1000)
        if matrix is not None:
            stream.set_display_matrix(matrix)
        for image, time_s in zip(images, times_s, strict=True):
            picture = av.VideoFrame.from_ndarray(image, format="rgb24")
            picture.time_base = stream.codec_context.time_base
            picture.pts = round(time_s / picture.time_base)
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    return path


def write_sound(path: Path, codec: str) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 44100), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 44100
        resampler = av.AudioResampler(
            format=stream.format, layout="mono", rate=44100, frame_size=stream.frame_size or 0
        )
        for part in resampler.resample(frame):
            container.mux(stream.encode(part))
        container.mux(stream.encode(None))
    return path


def write_pictures(folder: Path, names: Sequence[str], size: tuple[int, int] = (48, 64)) -> Path:
    """One picture for each name; its grey level is its position."""
    folder.mkdir(parents=True, exist_ok=True)
    for i, name in enumerate(names):
        Image.fromarray(grey(i, size)).save(folder / name)
    return folder


def cut(path: Path, to: Path, share: float) -> Path:
    data = path.read_bytes()
    to.write_bytes(data[: int(len(data) * share)])
    return to
