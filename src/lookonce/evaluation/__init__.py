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
from lookonce.evaluation.tracking.clear import ClearScores
from lookonce.evaluation.tracking.collecting import ResultCollector
from lookonce.evaluation.tracking.detrac.precision_recall import PRScores, pr_average, pr_scores
from lookonce.evaluation.tracking.detrac.scores import DetracScores
from lookonce.evaluation.tracking.detrac.truth import read_detrac_truth
from lookonce.evaluation.tracking.evaluate import PROTOCOLS, combine, evaluate_tracking
from lookonce.evaluation.tracking.hota import ALPHAS, HotaScores
from lookonce.evaluation.tracking.identity import IdentityScores
from lookonce.evaluation.tracking.motchallenge import read_motchallenge_truth
from lookonce.evaluation.tracking.scores import TrackingCounts, TrackingScores
from lookonce.evaluation.tracking.values import TrackingResult, TrackingTruth

__all__ = [
    "ALPHAS",
    "PROTOCOLS",
    "Aspect",
    "BreakdownBin",
    "ClassScores",
    "ClearScores",
    "DescribedObjects",
    "DetectionScores",
    "DetectionTruth",
    "DetracScores",
    "HotaScores",
    "IdentityScores",
    "OperatingPoint",
    "PRScores",
    "PairDistances",
    "PrecisionRecall",
    "RankOne",
    "ResultCollector",
    "Retrieval",
    "TrackingCounts",
    "TrackingResult",
    "TrackingScores",
    "TrackingTruth",
    "advice",
    "average_precision",
    "break_down",
    "combine",
    "equal_error_rate",
    "evaluate_tracking",
    "mean_average_precision",
    "nearest_distances",
    "pair_distances",
    "pr_average",
    "pr_scores",
    "precision_recall",
    "rank_gallery",
    "rank_one",
    "rates_at",
    "read_detrac_truth",
    "read_motchallenge_truth",
    "roc_auc",
    "threshold_at",
]
