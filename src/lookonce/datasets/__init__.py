"""Readers of labelled data: MOTChallenge, CVAT, UA-DETRAC and KITTI sequences, and YOLO stills."""

from lookonce.datasets.class_names import read_class_names, usual_name
from lookonce.datasets.labelled import LabelledFrame, LabelledObjects, LabelledSequence, LabelledStills
from lookonce.datasets.pictures import picture_size
from lookonce.datasets.sequences import open_sequences
from lookonce.datasets.stills import open_stills

__all__ = [
    "LabelledFrame",
    "LabelledObjects",
    "LabelledSequence",
    "LabelledStills",
    "open_sequences",
    "open_stills",
    "picture_size",
    "read_class_names",
    "usual_name",
]
