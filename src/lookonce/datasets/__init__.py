"""Readers of labelled data: MOTChallenge, CVAT, UA-DETRAC and KITTI sequences, YOLO stills, and files of tracks."""

from lookonce.datasets.class_names import read_class_names, usual_name
from lookonce.datasets.detrac_tracks import read_detrac_results
from lookonce.datasets.labelled import LabelledFrame, LabelledObjects, LabelledSequence, LabelledStills
from lookonce.datasets.mot_tracks import read_mot_results
from lookonce.datasets.pictures import picture_size
from lookonce.datasets.sequences import open_sequences
from lookonce.datasets.stills import open_stills
from lookonce.datasets.track_rows import TrackRows

__all__ = [
    "LabelledFrame",
    "LabelledObjects",
    "LabelledSequence",
    "LabelledStills",
    "TrackRows",
    "open_sequences",
    "open_stills",
    "picture_size",
    "read_class_names",
    "read_detrac_results",
    "read_mot_results",
    "usual_name",
]
