"""Where results go: MOT text, JSON lines, annotated video."""

from lookonce.output.annotated import AnnotatedVideoSink
from lookonce.output.checkpoint import CHECKPOINT_FILE, CheckpointSink, read_checkpoint
from lookonce.output.detrac import DETRAC_TABLES, write_detrac_tables
from lookonce.output.drawing import TrackPainter, draw_tracks
from lookonce.output.explained import ExplainSink
from lookonce.output.folder import prepare_output_folder
from lookonce.output.jsonl import JsonLinesSink
from lookonce.output.mot import MotSink
from lookonce.output.sink import Sink
from lookonce.output.trails import NO_TRAILS, TrailMemory, Trails

__all__ = [
    "CHECKPOINT_FILE",
    "DETRAC_TABLES",
    "NO_TRAILS",
    "AnnotatedVideoSink",
    "CheckpointSink",
    "ExplainSink",
    "JsonLinesSink",
    "MotSink",
    "Sink",
    "TrackPainter",
    "TrailMemory",
    "Trails",
    "draw_tracks",
    "prepare_output_folder",
    "read_checkpoint",
    "write_detrac_tables",
]
