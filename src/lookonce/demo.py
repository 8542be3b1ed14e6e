"""The whole package on a scene of its own making: nothing else is needed, and the truth is known."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lookonce.errors import OutputError
from lookonce.evaluation import ResultCollector, TrackingScores, TrackingTruth, evaluate_tracking
from lookonce.model import Model
from lookonce.output import AnnotatedVideoSink, JsonLinesSink, MotSink, TrackPainter, TrailMemory
from lookonce.pipeline import share_processors, track_video, tracker_for
from lookonce.synthetic import FrameTruth, SceneConfig, SyntheticScene
from lookonce.video import Frame, VideoSource, VideoWriter
from lookonce.video.source import Findings

__all__ = ["DemoResult", "run_demo"]

TRAIL_S = 2.0
_FRAME_SHOWN = 0.6  # of the way
_LEAST_VISIBLE, _LEAST_SIDE_PX = 0.3, 12.0  # objects of which less can be seen neither count nor are wrong when found


@dataclass(frozen=True, slots=True)
class DemoResult:
    """What came out.

    Attributes:
        scores: against the exact truth, all classes as one.
        frames: how many.
        objects: true identities that count.
        files: what was written: scene, video with tracks, a picture of one frame, results.
    """

    scores: TrackingScores
    frames: int
    objects: int
    files: tuple[Path, ...]


def run_demo(
    folder: Path,
    model: Model,
    scene: SceneConfig,
    *,
    preset: str = "default",
    report: Callable[[int, int], None] = lambda done, total: None,
) -> DemoResult:
    """Render a scene, track it, and hold the tracks against the truth.

    Args:
        folder: for scene.mp4, annotated.mp4, trails.png, tracks.txt and tracks.jsonl.
        model: with descriptors.
        scene: what is to be seen.
        preset: of the tracker.
        report: called with frames done and all frames.

    Raises:
        OutputError: a file cannot be written.
    """
    stage = _Stage(SyntheticScene(scene))
    video, tracker = stage.source(), tracker_for(model, preset)
    files = [folder / name for name in ("scene.mp4", "annotated.mp4", "trails.png", "tracks.txt", "tracks.jsonl")]
    trails, painter, tracked = TrailMemory(TRAIL_S), TrackPainter(model.names), ResultCollector()
    with ExitStack() as stack:
        writer = stack.enter_context(VideoWriter(files[0], scene.fps))
        annotated = stack.enter_context(AnnotatedVideoSink(files[1], model.names, scene.fps, TRAIL_S))
        about = {"demo": {"seed": scene.seed, "model": model.sha256, "tracker": preset}}
        json_lines = stack.enter_context(JsonLinesSink(files[4], about, model.names))
        sinks = [annotated, stack.enter_context(MotSink(files[3])), json_lines]
        _, workers = share_processors(is_live=False)
        for done, shown in enumerate(track_video(video, model, tracker, workers=workers, sinks=sinks), start=1):
            image = shown.image
            writer.write(image, shown.time_s)
            path = trails.update(shown.tracks, shown.time_s)
            if done == round(_FRAME_SHOWN * scene.frames):
                _save(painter.draw(image, shown.tracks.identified(), path), files[2])
            tracked.add(shown.index, shown.tracks)
            report(done, scene.frames)
    truth = stage.truth()
    scores = evaluate_tracking(truth, tracked.result(one_class=True))
    return DemoResult(scores, scene.frames, len(np.unique(truth.ids[truth.is_counted])), tuple(files))


class _Stage:
    """The scene as a source of frames that remembers what is true of each."""

    def __init__(self, scene: SyntheticScene) -> None:
        self._scene = scene
        self._truths: list[FrameTruth] = []

    def source(self) -> VideoSource:
        """Frames as from any other source."""
        count, rate = len(self._scene), self._scene.fps
        return VideoSource(self._frames, Findings(), name="demo", frame_count=count, rate=rate)

    def _frames(self) -> Generator[Frame]:
        self._truths.clear()
        for frame in self._scene:
            self._truths.append(frame.truth)
            yield Frame(frame.index, frame.time_s, frame.image)

    def truth(self) -> TrackingTruth:
        """Objects that can hardly be seen are neither to be found nor wrong when found."""
        objects = [truth.objects for truth in self._truths]
        xyxy = np.concatenate([part.xyxy for part in objects]).astype(np.float64)
        visibility = np.concatenate([part.visibility for part in objects])
        side = (xyxy[:, 2:] - xyxy[:, :2]).min(axis=1, initial=np.inf)
        is_counted = (visibility >= _LEAST_VISIBLE) & (side >= _LEAST_SIDE_PX)
        return TrackingTruth(
            frames=np.arange(len(objects), dtype=np.int64),
            row_frames=np.repeat(np.arange(len(objects)), [len(part) for part in objects]),
            ids=np.concatenate([part.identities for part in objects]),
            xyxy=xyxy,
            labels=np.concatenate([part.labels for part in objects]),
            is_counted=is_counted,
            is_distractor=~is_counted,
            ignored=self._scene.ignored.astype(np.float64),
        )


def _save(image: NDArray[np.uint8], path: Path) -> None:
    try:
        Image.fromarray(image).save(path)
    except OSError as exc:
        raise OutputError(f"{path}: cannot be written ({exc.strerror}); choose another folder with -o") from exc
