"""`lookonce explain`: the story of an identity in sentences."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lookonce.errors import ConfigError
from lookonce.report.explained import Candidate, ExplainedRow, Explanation, read_explanation

__all__ = ["explain_command"]

_FILE = "explain.jsonl"
_TAKEN = "taken"  # how a refusal begins that is no rule's: another detection got the object
_DOUBT = 1.5  # costs that are nearer to each other than this: a coin toss of one in five

_EXAMPLES = """
[bold]Examples[/bold]

  lookonce track traffic.mp4 --explain -o out/          (writes out/explain.jsonl beside the results)

  lookonce explain out/ --id 7                          (the story of identity 7, with the frames where it was in doubt)

  lookonce explain out/ --frame 120                     (every detection of frame 120, counted from 0)

  lookonce explain out/                                 (the identities that were most in doubt)
"""


def explain_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run with --explain.", show_default=False)],
    identity: Annotated[int | None, typer.Option("--id", help="Tell this identity's story.", min=1)] = None,
    frame: Annotated[int | None, typer.Option(help="Tell what was decided in this frame, from 0.", min=0)] = None,
    most: Annotated[int, typer.Option(help="Tell at most so many doubts.", min=1)] = 20,
) -> None:
    """Say why detections got their identities."""
    path = run / _FILE if run.is_dir() else run
    if not path.exists():
        raise ConfigError(f"{path}: there is none; track again with --explain")
    told = read_explanation(path)
    if frame is not None:
        _tell_frame(told, path, frame)
    if identity is not None:
        _tell_identity(told, path, identity, most)
    if frame is None and identity is None:
        _tell_doubts(told, most)


explain_command.__doc__ = f"{explain_command.__doc__}\n{_EXAMPLES}"


def _tell_frame(told: Explanation, path: Path, frame: int) -> None:
    if frame not in told.rows:
        raise ConfigError(f"{path}: has no frame {frame}; it has {_span(told)}")
    print(f"{_when(told, frame)}: {len(told.rows[frame])} detections")
    for number, row in enumerate(told.rows[frame]):
        box = (
            ""
            if row.xyxy is None
            else f" at {row.xyxy[0]:.0f},{row.xyxy[1]:.0f} to {row.xyxy[2]:.0f},{row.xyxy[3]:.0f}"
        )
        print(f"  row {number}{box}: {row.decision}; {row.reason}")
        for other in row.candidates:
            if other.refused:
                print(f"    not id {other.id}: {other.refused}")


def _tell_identity(told: Explanation, path: Path, identity: int, most: int) -> None:
    rows = [(frame, row) for frame in sorted(told.rows) for row in told.rows[frame] if row.id == identity]
    if not rows:
        raise ConfigError(f"{path}: no detection has id {identity}; see tracks.txt for the ids there are")
    given_back = [one for (_, own), frames in told.given_back.items() if own == identity for one in frames]
    filled = [one for (_, own), frames in told.filled.items() if own == identity for one in frames]
    first, last = min([rows[0][0], *given_back]), rows[-1][0]
    gaps = f", missed and filled in {len(filled)} frames between" if filled else ""
    count = len(rows) + len(given_back)
    print(f"id {identity}: {count} detections from {_when(told, first)} to {_when(told, last)}{gaps}.")
    moments = [_birth(*told.begun[identity])] if identity in told.begun else []
    moments += [(frame, text) for frame, row in rows if (text := _moment(told, frame, row))]
    for frame, text in moments[:most]:
        print(f"  {_when(told, frame)}: {text}.")
    if len(moments) > most:
        print(f"  and {len(moments) - most} more such moments; --most {len(moments)} tells them all")
    for ending in told.endings.get(identity, ()):
        print(f"  {_when(told, ending.frame)}: ended, {ending.why}.")
    if not moments:
        print("  Never in doubt: in each frame one detection fitted, and no other object came near it.")


def _birth(frame: int, row: ExplainedRow) -> tuple[int, str]:
    """What became of its first detection, and why it was nobody's who was known."""
    others = [f"not id {one.id}: {one.refused}" for one in row.candidates if one.refused]
    return frame, "; ".join([f"{row.decision}, {row.reason}", *others])


def _moment(told: Explanation, frame: int, row: ExplainedRow) -> str:
    """What is worth telling of a row; empty where it went on as before without a rival."""
    parts = [_doubt(row), _contender(told, frame, row)]
    if row.id is not None and (given_back := told.given_back.get((frame, row.id))):
        parts.append(f"the id goes back to {_frames(given_back)}")
    if row.id is not None and (filled := told.filled.get((frame, row.id))):
        parts.append(f"boxes filled in for {_frames(filled)}")
    if row.decision == "kept":
        return "; ".join([*filter(None, parts), row.reason]) if any(parts) else ""
    return "; ".join(filter(None, [f"{row.decision}, {row.reason}", *parts]))


def _contender(told: Explanation, frame: int, row: ExplainedRow) -> str:
    """Which other detection may be the identity's; empty if none comes near."""
    if not row.candidates or (own := row.candidates[0].cost) is None:
        return ""
    near = [
        (one.cost - own, number)
        for number, other in enumerate(told.rows[frame])
        for one in other.candidates
        if other is not row and one.id == row.id and one.refused.startswith(_TAKEN) and one.cost is not None
    ]
    worse, number = min(near, default=(_DOUBT, 0))
    if worse >= _DOUBT:
        return ""
    how = f"only {worse:.1f} worse" if worse >= 0 else f"{-worse:.1f} better, but not for all together"
    return f"in doubt, row {number} fitted {how}"


def _frames(frames: tuple[int, ...]) -> str:
    """Frames, rising, in words."""
    return f"frame {frames[0]}" if len(frames) == 1 else f"{len(frames)} frames from {frames[0]} to {frames[-1]}"


def _doubt(row: ExplainedRow) -> str:
    """Who else may be meant; empty if nobody."""
    rival = _rival(row)
    if rival is None:
        return ""
    other, behind = rival
    if behind >= 0:
        return f"in doubt, id {other.id} was only {behind:.1f} behind"
    why = f"was {other.refused}" if other.refused else "not best for the frame"
    return f"in doubt, id {other.id} fitted better by {-behind:.1f}, but {why}"


def _rival(row: ExplainedRow) -> tuple[Candidate, float] | None:
    """The next likely object and by how much it is behind the own one, if that is little; below 0: it is ahead."""
    if not row.candidates or (own := row.candidates[0].cost) is None:
        return None
    others = [one for one in row.candidates[1:] if not one.refused or one.refused.startswith(_TAKEN)]
    behind = [(one.cost - own, one.id, one) for one in others if one.cost is not None and one.cost < 0]
    nearest = min(behind, default=None, key=lambda found: found[:2])
    return (nearest[2], nearest[0]) if nearest is not None and nearest[0] < _DOUBT else None


def _tell_doubts(told: Explanation, most: int) -> None:
    doubts: dict[int, list[int]] = {}
    for frame in sorted(told.rows):
        for row in told.rows[frame]:
            if row.id is not None and (row.decision == "refound" or _rival(row) or _contender(told, frame, row)):
                doubts.setdefault(row.id, []).append(frame)
    counts = ", ".join(f"{count} {name}" for name, count in told.counts().items())
    print(f"{len(told.rows)} frames, {_span(told)}: {counts}")
    if not doubts:
        print("No identity was ever in doubt.")
    for identity, frames in sorted(doubts.items(), key=lambda item: (-len(item[1]), item[0]))[:most]:
        print(f"  id {identity}: in doubt or refound in {len(frames)} frames, first in {_when(told, frames[0])}")


def _when(told: Explanation, frame: int) -> str:
    time_s = told.times_s.get(frame)
    return f"frame {frame}" if time_s is None else f"frame {frame} ({time_s:.2f} s)"


def _span(told: Explanation) -> str:
    return f"frames {min(told.rows)} to {max(told.rows)}" if told.rows else "no frames"
