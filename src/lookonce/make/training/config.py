"""The settings of a training run."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields

from lookonce.errors import ConfigError

__all__ = ["FitConfig"]

_RANGES: dict[str, tuple[float, float]] = {
    "seed": (0, 2**32 - 1),
    "views": (0, 1000),
    "collages": (0, 1000),
    "variants": (0, 100),
    "crowds": (0, 100_000),
    "sequence_frames": (2, 1_000_000),
    "score": (0.01, 1),
    "held_out": (0.01, 0.5),
    "steps": (1, 10_000_000),
    "identities": (2, 100_000),
    "rows": (2, 1000),
    "embedding": (4, 1024),
    "gate": (4, 1024),
    "shared_space": (0, 100),
    "learning_rate": (1e-7, 1),
    "weight_decay": (0, 1),
    "temperature": (0.01, 1),
    "check_every": (1, 1_000_000),
    "patience": (1, 1_000_000),
    "cache_gb": (0.01, 1000),
}
_READING = 2  # raised where other features come of the same settings
_AFTER_READING = frozenset(
    (
        "steps",
        "identities",
        "rows",
        "embedding",
        "gate",
        "shared_space",
        "learning_rate",
        "weight_decay",
        "temperature",
        "check_every",
        "patience",
    )
)


@dataclass(frozen=True, slots=True)
class FitConfig:
    """All that a trained head depends on, besides the data and the model file.

    Attributes:
        kind: ``compact`` or ``paper``.
        seed: of every random choice.
        views: transformed views of each still.
        collages: how often each object of a still is put into a collage.
        variants: so many more identities are made of each object of a still by other colours.
        crowds: so many rendered crowds, each of 28 people, where the detector knows people.
        sequence_frames: of each sequence or video at most so many frames, evenly spread.
        score: least confidence of the detections that stand in for labels.
        held_out: share of identities kept for validation.
        steps: of the optimizer, at most.
        identities: in a batch, about.
        rows: of each identity in a batch, at most.
        embedding: numbers that kind compact makes of each point of a box; the model file grows with it.
        gate: numbers by which kind compact decides which points count; its time in the model grows with it.
        shared_space: weight of the loss that holds together what kind compact's two networks, for people and for all
            else, say of one object. Worth it where the detector takes one object now for a person, now for something
            else; 0.5 is a good value.
        learning_rate: the highest; it rises over the first tenth of the steps and falls to nothing (one cycle).
        weight_decay: of AdamW.
        temperature: of the contrastive loss (kind compact).
        check_every: steps between two looks at the validation identities.
        patience: stop after so many looks without a better one.
        cache_gb: room for features on disk, and in memory while training, in 10^9 bytes.
    """

    kind: str = "compact"
    seed: int = 0
    views: int = 2
    collages: int = 4
    variants: int = 1
    crowds: int = 120
    sequence_frames: int = 300
    score: float = 0.4
    held_out: float = 0.1
    steps: int = 1200
    identities: int = 160
    rows: int = 4
    embedding: int = 48
    gate: int = 16
    shared_space: float = 0.0
    learning_rate: float = 3e-3
    weight_decay: float = 1e-3
    temperature: float = 0.1
    check_every: int = 200
    patience: int = 5
    cache_gb: float = 1.0

    def __post_init__(self) -> None:
        if self.kind not in ("compact", "paper"):
            raise ConfigError(f"kind '{self.kind}': expected compact or paper")
        for field in fields(self):
            low, high = _RANGES.get(field.name, (None, None))
            value = getattr(self, field.name)
            if low is not None and high is not None and not low <= value <= high:
                raise ConfigError(f"{field.name}={value}: expected {low:g} to {high:g}")

    def for_reading(self) -> dict[str, object]:
        """The settings that features depend on, by name; runs that agree in them can share features."""
        settings = {name: value for name, value in asdict(self).items() if name not in _AFTER_READING}
        return settings | {"version": _READING}
