"""How good results are, as numbers: knows the truth and the results, and no tracker."""

from lookonce.evaluation.detection.curve import OperatingPoint, PrecisionRecall, precision_recall
from lookonce.evaluation.detection.precision import ClassScores, DetectionScores, average_precision
from lookonce.evaluation.detection.truth import DetectionTruth
from lookonce.evaluation.retrieval.advice import advice
from lookonce.evaluation.retrieval.breakdown import Aspect, BreakdownBin, break_down
from lookonce.evaluation.retrieval.objects import DescribedObjects
from lookonce.evaluation.retrieval.pairs import PairDistances, pair_distances
from lookonce.evaluation.retrieval.ranking import (
    RankOne,
    Retrieval,
    mean_average_precision,
    nearest_distances,
    rank_gallery,
    rank_one,
)
from lookonce.evaluation.retrieval.rates import equal_error_rate, rates_at, roc_auc, threshold_at

__all__ = [
    "Aspect",
    "BreakdownBin",
    "ClassScores",
    "DescribedObjects",
    "DetectionScores",
    "DetectionTruth",
    "OperatingPoint",
    "PairDistances",
    "PrecisionRecall",
    "RankOne",
    "Retrieval",
    "advice",
    "average_precision",
    "break_down",
    "equal_error_rate",
    "mean_average_precision",
    "nearest_distances",
    "pair_distances",
    "precision_recall",
    "rank_gallery",
    "rank_one",
    "rates_at",
    "roc_auc",
    "threshold_at",
]
