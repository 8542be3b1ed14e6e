"""The settings of a detector's training."""

from __future__ import annotations

from dataclasses import dataclass, fields

from lookonce.errors import ConfigError

__all__ = ["DetectorConfig"]

_CHOICES: dict[str, tuple[str, ...]] = {
    "positives": ("several", "best"),
    "box_loss": ("ciou", "giou", "squared"),
    "objectness": ("overlap", "one"),
    "precision": ("auto", "32-true", "bf16-mixed", "16-mixed"),
}
_RANGES: dict[str, tuple[float, float]] = {
    "seed": (0, 2**32 - 1),
    "epochs": (1, 100_000),
    "batch": (1, 4096),
    "learning_rate": (1e-7, 1),
    "weight_decay": (0, 1),
    "warm_up_epochs": (0, 1000),
    "average_decay": (0, 0.99999),
    "label_smoothing": (0, 0.5),
    "ignore_overlap": (0.1, 1),
    "box_weight": (0, 100),
    "objectness_weight": (0, 100),
    "class_weight": (0, 100),
    "mosaic": (0, 1),
    "plain_epochs": (0, 100_000),
    "least_side_px": (0, 100),
    "video_frames": (1, 1_000_000),
    "teacher_score": (0.01, 1),
    "teacher_doubt": (0.01, 1),
    "held_out": (0.01, 0.5),
    "check_every": (1, 100_000),
    "patience": (1, 100_000),
    "cache_gb": (0, 1000),
}


@dataclass(frozen=True, slots=True)
class DetectorConfig:
    """All that a trained detector depends on, besides the network, the data and the weights it starts from.

    Why the defaults are what they are: docs/decisions/0012-detector-training.md.

    Attributes:
        seed: of every random choice.
        epochs: passes over the training pictures.
        batch: pictures in a step, over all devices.
        learning_rate: the highest; it rises over the warm-up and falls along half a cosine to a hundredth.
        weight_decay: of AdamW, for kernels only.
        warm_up_epochs: length of the rise.
        average_decay: of the moving average of the weights, which is what is kept (EMA); 0: none.
        positives: ``several`` anchors answer for an object, those that fit it best at the time (after SimOTA), or the
            ``best`` by shape alone, as published.
        box_loss: ``ciou``, ``giou``, or ``squared`` errors of the raw outputs, as published.
        objectness: what it learns at a positive: the ``overlap`` that its box reaches, or ``one``, as published.
        label_smoothing: of the classes.
        ignore_overlap: anchors whose box overlaps an object more than this are no negatives.
        box_weight, objectness_weight, class_weight: of the three parts of the loss.
        mosaic: share of the training pictures that are made of four.
        plain_epochs: so many last epochs go without mosaics.
        fit_anchors: whether anchors are fitted to the data; otherwise the network's own are kept.
        least_side_px: objects smaller than this on the network's input are neither taught nor negatives.
        video_frames: of each sequence or video at most so many frames, evenly spread.
        teacher_score: the teacher's detections from here on are labels.
        teacher_doubt: between this and ``teacher_score`` they are neither taught nor negatives.
        held_out: share of the pictures kept for validation, and of sequences where there are five or no stills.
        check_every: epochs between two looks at the validation pictures.
        patience: stop after so many looks without a better one.
        precision: of the arithmetic; ``auto`` mixes in bfloat16 on a GPU and on CPUs that have instructions for it.
        cache_gb: room for decoded pictures in memory, 10^9 bytes.
    """

    seed: int = 0
    epochs: int = 100
    batch: int = 16
    learning_rate: float = 2e-3
    weight_decay: float = 0.02
    warm_up_epochs: float = 2.0
    average_decay: float = 0.9995
    positives: str = "several"
    box_loss: str = "ciou"
    objectness: str = "overlap"
    label_smoothing: float = 0.02
    ignore_overlap: float = 0.7
    box_weight: float = 5.0
    objectness_weight: float = 1.0
    class_weight: float = 1.0
    mosaic: float = 0.7
    plain_epochs: int = 10
    fit_anchors: bool = True
    least_side_px: float = 4.0
    video_frames: int = 100
    teacher_score: float = 0.5
    teacher_doubt: float = 0.15
    held_out: float = 0.08
    check_every: int = 5
    patience: int = 10
    precision: str = "auto"
    cache_gb: float = 3.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in _RANGES:
                low, high = _RANGES[field.name]
                if not low <= value <= high:
                    raise ConfigError(f"{field.name} {value}: expected {low:g} to {high:g}")
            elif field.name in _CHOICES and value not in _CHOICES[field.name]:
                raise ConfigError(f"{field.name} '{value}': expected {', '.join(_CHOICES[field.name])}")
        if self.teacher_doubt > self.teacher_score:
            raise ConfigError(f"teacher_doubt {self.teacher_doubt}: expected at most teacher_score")
