"""Any video source as an iterator of frames, and the video writer."""

from lookonce.video.frame import Frame
from lookonce.video.open import open_video
from lookonce.video.opening import without_password
from lookonce.video.prefetch import Prefetcher, prefetch
from lookonce.video.source import VideoSource
from lookonce.video.writer import VideoWriter

__all__ = ["Frame", "Prefetcher", "VideoSource", "VideoWriter", "open_video", "prefetch", "without_password"]
