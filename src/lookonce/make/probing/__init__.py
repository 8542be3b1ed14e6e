"""What descriptors see: how far they tell labelled objects apart, whom they take for whom, in numbers and pictures."""

from lookonce.make.probing.crops import neighbourhoods
from lookonce.make.probing.describing import Reading, Tally, describe_sequences, read_sequences
from lookonce.make.probing.distances import draw_distances
from lookonce.make.probing.gaps import Gap, GapLimits
from lookonce.make.probing.measuring import Measures, measure
from lookonce.make.probing.neighbours import Neighbourhood, ShownObject, draw_neighbours
from lookonce.make.probing.probe import ASPECTS, ProbeResult, ProbeSettings, choose_classes, probe
from lookonce.make.probing.queries import choose_queries, nearest
from lookonce.make.probing.reading import BoxReader, open_reader
from lookonce.make.probing.report import PROBE_FILES, report_json, write_report

__all__ = [
    "ASPECTS",
    "PROBE_FILES",
    "BoxReader",
    "Gap",
    "GapLimits",
    "Measures",
    "Neighbourhood",
    "ProbeResult",
    "ProbeSettings",
    "Reading",
    "ShownObject",
    "Tally",
    "choose_classes",
    "choose_queries",
    "describe_sequences",
    "draw_distances",
    "draw_neighbours",
    "measure",
    "nearest",
    "neighbourhoods",
    "open_reader",
    "probe",
    "read_sequences",
    "report_json",
    "write_report",
]
