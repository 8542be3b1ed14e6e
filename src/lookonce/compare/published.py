"""Figures that others have published and that cannot be made again here: their detectors or trackers are not to be had.

Sources: the publication of our method, its tables 1 and 2; and UA-DETRAC's test server for PR-MOTA.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["PUBLISHED", "PUBLISHED_PR", "PUBLISHED_SPEED", "PublishedQuality", "PublishedSpeed"]


@dataclass(frozen=True, slots=True)
class PublishedQuality:
    """A row of the publication's table 1, or of the server's: shares from 0 to 1.

    Attributes:
        detector: that found the boxes.
        tracker: that gave identities.
        mota: MOTA, or PR-MOTA.
        motp: MOTP; None where it is not stated.
    """

    detector: str
    tracker: str
    mota: float
    motp: float | None


@dataclass(frozen=True, slots=True)
class PublishedSpeed:
    """A row of the publication's table 2: frames a second, of which stages it does not say."""

    method: str
    fps: float


PUBLISHED = (
    PublishedQuality("DPM", "GOG", 0.262, 0.762),
    PublishedQuality("ACF", "GOG", 0.357, 0.803),
    PublishedQuality("R-CNN", "DCT", 0.384, 0.806),
    PublishedQuality("Faster R-CNN", "MHT", 0.582, 0.784),
    PublishedQuality("EB", "KIOU", 0.621, 0.819),
    PublishedQuality("YOLOv3", "the published method", 0.676, 0.891),
)
"""Table 1: MOTA and MOTP on UA-DETRAC."""

PUBLISHED_PR = (
    PublishedQuality("Mask R-CNN", "V-IOU", 0.307, None),
    PublishedQuality("EB", "KIOU", 0.211, None),
    PublishedQuality("EB", "IOU", 0.194, None),
    PublishedQuality("CompACT", "GOG", 0.142, None),
)
"""PR-MOTA on the test set, by the server."""

PUBLISHED_SPEED = (
    PublishedSpeed("Siamese CNN", 2.1),
    PublishedSpeed("RNN-LSTM", 166.8),
    PublishedSpeed("JPDA", 35.6),
    PublishedSpeed("LSTM-DRL", 108.0),
    PublishedSpeed("the published method", 207.6),
)
"""Table 2: frames a second, on machines that differ."""
