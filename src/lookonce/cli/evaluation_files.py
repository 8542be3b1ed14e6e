"""What `lookonce eval` writes: all figures as JSON and CSV, with what they depend on; same input, same bytes."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from lookonce import __version__
from lookonce.cli.evaluated_results import digest
from lookonce.cli.evaluated_runs import EvaluatedRun, EvaluatedSequence
from lookonce.cli.evaluated_truth import TrueSequence
from lookonce.cli.figures import Scores, figures_of
from lookonce.errors import OutputError
from lookonce.output.append_only import AppendOnlyFile
from lookonce.video.opening import one_line

__all__ = ["check_output", "csv_text", "json_text", "write_text"]

_FORMAT = {"format": "lookonce-evaluation", "format_version": 1}
_FIXED = ("version", "protocol", "benchmark", "run", "sequence", "class", "truth_sha256", "results_sha256")
COMBINED, ALL_CLASSES = "COMBINED", "ALL"


def check_output(path: Path | None, overwrite: bool) -> None:
    """Refuses a file that cannot or must not be written, before any work is done.

    Raises:
        OutputError: it exists and ``overwrite`` is False, is a folder, or its folder is not there.
    """
    if path is None:
        return
    if os.path.isdir(path) or not os.path.isdir(path.absolute().parent):
        raise OutputError(f"{one_line(path)}: a folder, or in a folder that is not there; name a file")
    if os.path.exists(path) and not overwrite:
        raise OutputError(f"{one_line(path)} exists; give --overwrite to replace it, or another name")


def write_text(path: Path, text: str) -> None:
    """Writes a UTF-8 file.

    Raises:
        OutputError: it cannot be written.
    """
    file = AppendOnlyFile(path)
    file.append(text.encode("utf-8", errors="replace"))
    file.close()


def json_text(
    settings: Mapping[str, object],
    truth: Sequence[TrueSequence],
    runs: Sequence[EvaluatedRun],
    more: Mapping[str, object],
) -> str:
    """All figures of all runs, by sequence, combined and by class; shares as 0 to 1.

    Args:
        settings: protocol and all else that the figures depend on.
        truth: the sequences.
        runs: one or more.
        more: further facts, such as PR figures.
    """
    sequences = [
        {"name": one.name, "file": one_line(one.file), "sha256": digest([one.file]), "classes": list(one.classes)}
        for one in truth
    ]
    content = {**_FORMAT, "version": __version__, **settings, "truth": sequences, "runs": [*map(_run, runs)], **more}
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _run(run: EvaluatedRun) -> dict[str, object]:
    return {
        "name": run.name,
        "combined": _scores(run.combined),
        "per_class": {name: _scores(scores) for name, scores in run.by_class.items()},
        "classes_not_in_truth": dict(run.unknown_classes),
        "sequences": [
            {
                "name": one.name,
                "files": [one_line(path) for path in one.file.paths] if one.file else [],
                "sha256": _digest_of(one),
                "boxes_in_results": one.boxes,
                **_scores(one.scores),
                "per_class": {name: _scores(scores) for name, scores in one.by_class.items()},
            }
            for one in run.sequences
        ],
    }


def _scores(scores: Scores) -> dict[str, object]:
    return {"figures": figures_of(scores), "left_out": dict(sorted(scores.left_out.items()))}


def _digest_of(sequence: EvaluatedSequence) -> str | None:
    return digest(sequence.file.paths) if sequence.file else None


def csv_text(settings: Mapping[str, object], truth: Sequence[TrueSequence], runs: Sequence[EvaluatedRun]) -> str:
    """A line for each run, sequence and class; ``COMBINED`` = over the sequences, ``ALL`` = classes as one."""
    text = io.StringIO()
    figures = list(figures_of(runs[0].combined))
    writer = csv.DictWriter(text, [*_FIXED, *figures, "left_out"], lineterminator="\n")
    writer.writeheader()
    about = {"version": __version__, "protocol": settings["protocol"], "benchmark": settings["benchmark"] or ""}
    digests = {one.name: digest([one.file]) for one in truth}
    for run in runs:
        for sequence in run.sequences:
            where = {"sequence": sequence.name, "truth_sha256": digests[sequence.name]}
            where["results_sha256"] = _digest_of(sequence) or ""
            for row in _rows(sequence.scores, sequence.by_class):
                writer.writerow({**about, "run": run.name, **where, **row})
        for row in _rows(run.combined, run.by_class):
            writer.writerow({**about, "run": run.name, "sequence": COMBINED, **row})
    return text.getvalue()


def _rows(scores: Scores, by_class: Mapping[str, Scores]) -> Iterator[dict[str, object]]:
    for name, one in ((ALL_CLASSES, scores), *by_class.items()):
        yield {"class": name, **figures_of(one), "left_out": sum(one.left_out.values())}
