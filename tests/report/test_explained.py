"""The tracker's own explanation: read with care, unknown fields ignored."""

from __future__ import annotations

from pathlib import Path

import pytest

from datasets.making import refusal, write
from lookonce.errors import FormatError
from lookonce.report.explained import Ending, read_explanation
from report.scenes import HEADER, write_lines

ROW = {
    "row": 0,
    "id": 7,
    "xyxy": [1, 2, 3, 4],
    "score": 0.8,
    "label": 2,
    "decision": "refound",
    "reason": "looks the same",
    "candidates": [
        {"id": 7, "cost": 0.21, "overlap": 0.7, "distance": None, "motion": 0.8, "unseen_s": 0.5, "refused": None},
        {"id": 4, "cost": 0.3, "refused": "too far away", "new_field": {"x": [1]}},
    ],
    "more": "of it",
}


def test_everything_is_read(tmp_path: Path):
    path = write_lines(
        tmp_path / "explain.jsonl",
        {**HEADER, "tracker": "x"},
        {"frame": 12, "time_s": 0.48, "rows": [ROW, {"id": None}], "ended": [{"id": 5, "why": "unseen for 3.0 s"}]},
        {"frame": 13, "rows": [], "ended": [{"id": 5}]},
        {
            "frame": 14,
            "given_back": [
                {"frame": 12, "row": 0, "id": 8},
                {"frame": 7, "row": 0, "id": 8},
                {"frame": 12, "row": 99, "id": 6},
                {"frame": 3},
            ],
            "filled": [{"frame": 12, "id": 7}],
        },
    )
    found = read_explanation(path)
    row = found.of(12, 7)
    assert (row.decision, row.reason, row.xyxy) == ("refound", "looks the same", (1.0, 2.0, 3.0, 4.0))
    assert [(one.id, one.cost, one.distance, one.refused) for one in row.candidates] == [
        (7, 0.21, None, ""),
        (4, 0.3, None, "too far away"),
    ]
    assert found.of(12, 4) is None
    assert found.of(99, 7) is None
    assert found.times_s == {12: 0.48}
    assert found.ending(5, 0, 12) == Ending(12, "unseen for 3.0 s")
    assert found.ending(5, 0, 20) == Ending(13, "")
    assert found.ending(5, 14, 20) is None
    assert found.counts() == {"refound": 1, "not said": 1}
    assert found.given_back == {(14, 8): (7, 12), (14, 6): (12,)}
    assert found.begun == {8: (12, row)}
    assert found.filled == {(14, 7): (12,)}


@pytest.mark.parametrize(
    ("record", "said"),
    [
        pytest.param({"rows": []}, "frame", id="no-frame"),
        pytest.param({"frame": -1}, "frame", id="negative-frame"),
        pytest.param({"frame": True}, "frame", id="bool-frame"),
        pytest.param({"frame": 1, "rows": {}}, "rows", id="rows"),
        pytest.param({"frame": 1, "rows": [3]}, "rows", id="row"),
        pytest.param({"frame": 1, "rows": [{"id": "7"}]}, "id", id="id"),
        pytest.param({"frame": 1, "rows": [{"xyxy": [1, 2, 3]}]}, "xyxy", id="three-numbers"),
        pytest.param({"frame": 1, "rows": [{"xyxy": [5, 2, 3, 4]}]}, "xyxy", id="negative-size"),
        pytest.param({"frame": 1, "rows": [{"xyxy": [1, 2, 3, 10**400]}]}, "xyxy", id="far-away"),
        pytest.param({"frame": 1, "rows": [{"decision": 3}]}, "decision", id="decision"),
        pytest.param({"frame": 1, "rows": [{"reason": ["x"]}]}, "reason", id="reason"),
        pytest.param({"frame": 1, "rows": [{"candidates": [{"id": 1, "cost": "x"}]}]}, "cost", id="cost"),
        pytest.param({"frame": 1, "rows": [{"candidates": [{"id": 1, "cost": 10**400}]}]}, "cost", id="huge-cost"),
        pytest.param({"frame": 1, "ended": "x"}, "ended", id="ended"),
        pytest.param({"frame": 1, "given_back": [3]}, "given_back", id="given-back"),
        pytest.param({"frame": 1, "filled": [{"id": 3}]}, "frame", id="filled-without-frame"),
        pytest.param({"frame": 0}, "second time", id="frame-twice"),
        pytest.param([1], "JSON object", id="list"),
    ],
)
def test_faults_are_named_by_line(record, said, tmp_path: Path):
    path = write_lines(tmp_path / "explain.jsonl", HEADER, {"frame": 0}, record)
    message = refusal(FormatError, lambda: read_explanation(path))
    assert said in message
    assert message.startswith(f"{path}:3: ")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        pytest.param("", "expected a header", id="empty"),
        pytest.param('{"format":"lookonce-tracks","format_version":1}\n', "expected a header", id="another-format"),
        pytest.param('{"format":"lookonce-explain","format_version":2}\n', "expected 1", id="version"),
        pytest.param('{"format":"lookonce-explain","format_version":1}\n{"frame":NaN}\n', "no JSON", id="nan"),
        pytest.param('{"format":"lookonce-explain","format_version":1}\n{"frame":1', "no JSON", id="cut"),
        pytest.param("[" * 100_000, "no JSON", id="deep"),
    ],
)
def test_files_that_are_none_are_refused(text, said, tmp_path: Path):
    path = write(tmp_path / "explain.jsonl", text)
    assert said in refusal(FormatError, lambda: read_explanation(path))
