"""A page with which a person judges a tracking run; knows truth and results, and no tracker."""

from lookonce.report.page import page_text
from lookonce.report.views import Report, ScoreColumn, ScoreRow, ScoreTable, SequenceView, doubted_view, scored_view

__all__ = [
    "Report",
    "ScoreColumn",
    "ScoreRow",
    "ScoreTable",
    "SequenceView",
    "doubted_view",
    "page_text",
    "scored_view",
]
