"""Small scenes for these tests."""

from __future__ import annotations

import hashlib

from lookonce.synthetic import SceneConfig, SyntheticScene

SMALL = {"height": 90, "width": 160, "fps": 10.0, "min_px": 2.0}


def small_config(**settings: object) -> SceneConfig:
    return SceneConfig(**{"seconds": 0.3, **SMALL, **settings})  # type: ignore[arg-type]


def digest(scene: SyntheticScene) -> str:
    """One hash of all pictures and all truth."""
    sha = hashlib.sha256(scene.ignored.tobytes())
    for frame in scene:
        truth = frame.truth
        for array in (frame.image, truth.objects.xyxy, truth.objects.identities, truth.objects.labels):
            sha.update(array.tobytes())
        for array in (truth.objects.visibility, truth.hidden, truth.hidden_by, truth.heading_deg):
            sha.update(array.tobytes())
        sha.update(repr((truth.kinds, truth.left_out)).encode())
    return sha.hexdigest()
