"""What `lookonce tune` shows in the end: what changed, what mattered, and whether it holds on other data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lookonce.cli.figures import choose_columns, figures_of, print_table
from lookonce.cli.tuning_data import TuningData
from lookonce.evaluation import TrackingScores
from lookonce.tracking import TrackerConfig
from lookonce.tuning.ranges import SearchRange, setting_value
from lookonce.tuning.scoring import Gain, Scorer, objective_value
from lookonce.tuning.trials import Trial

__all__ = ["TunedFigures", "print_tuned", "toml_lines"]

_COLUMNS = "HOTA,DetA,AssA,IDF1,MOTA,IDSW,FP,FN"
_MOST_SETTINGS = 12
_FEW_TRIALS = "too few trials to say what mattered"


@dataclass(frozen=True, slots=True)
class TunedFigures:
    """Before and after.

    Attributes:
        objective: one of ``OBJECTIVES``.
        before, after: the settings.
        rows: figures by what they are of, such as ``held out, after``.
        searched, held_out: the objective before and after.
        gain: on what was held out.
    """

    objective: str
    before: TrackerConfig
    after: TrackerConfig
    rows: Mapping[str, TrackingScores]
    searched: tuple[float, float]
    held_out: tuple[float, float]
    gain: Gain

    @classmethod
    def of(
        cls, objective: str, before: TrackerConfig, after: TrackerConfig, searched: Scorer, held_out: Scorer
    ) -> TunedFigures:
        """Scores both settings on both parts of the data."""
        rows: dict[str, TrackingScores] = {}
        values = []
        for part, scorer in (("searched", searched), ("held out", held_out)):
            both = [scorer.scores(before)]
            both.append(both[0] if before == after else scorer.scores(after))
            values.append((objective_value(objective, both[0]), objective_value(objective, both[1])))
            for number, step in enumerate(scorer.every):
                rate = f", every {step}" if len(scorer.every) > 1 else ""
                for when, scores in zip(("before", "after")[: 1 + (before != after)], both, strict=False):
                    rows[f"{part}{rate}, {when}"] = scores[number]
        gain = Gain(0.0, 0.0) if before == after else held_out.gain(objective, before, after)
        return cls(objective, before, after, rows, values[0], values[1], gain)

    @property
    def in_words(self) -> str:
        """What was gained where nobody searched, and what to make of it."""
        name = self.objective.upper()
        if self.before == self.after:
            return "nothing better was found: the settings to begin with are good"
        before, after = (100 * value for value in self.held_out)
        held = f"held out: {name} {before:.1f} -> {after:.1f}"
        by_parts = f"{100 * self.gain.value:+.1f} ± {100 * self.gain.error:.1f} over parts of it"
        if self.gain.is_clear and after > before:
            return f"{held}, {by_parts}: a gain beyond noise"
        return f"{held}, {by_parts}: no gain beyond noise, so the settings to begin with are good"


def print_tuned(
    figures: TunedFigures, trials: Sequence[Trial], ranges: Sequence[SearchRange], data: TuningData
) -> None:
    """Two tables and a sentence on stdout."""
    from lookonce.tuning.proposing import importances  # needs Optuna

    shares = importances(trials, ranges)
    if figures.before != figures.after:
        _print_settings(figures, ranges, shares)
    columns = choose_columns(_COLUMNS, "trackeval")
    rows = [(name, figures_of(scores)) for name, scores in figures.rows.items()]
    print_table("", "protocol trackeval", rows, columns)
    print(data.in_words)
    print(figures.in_words)


def _print_settings(figures: TunedFigures, ranges: Sequence[SearchRange], shares: Mapping[str, float]) -> None:
    table = Table(
        title=Text("what changed, and how much it mattered" if shares else f"what changed; {_FEW_TRIALS}"),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    for number, heading in enumerate(("setting", "before", "after", *(["mattered"] if shares else []))):
        table.add_column(heading, justify="right" if number else "left")
    by_share = sorted((one.name for one in ranges), key=lambda name: -shares.get(name, 0.0))
    for name in by_share[:_MOST_SETTINGS]:
        both = (f"{setting_value(config, name):g}" for config in (figures.before, figures.after))
        table.add_row(name, *both, *([f"{100 * shares[name]:.0f} %"] if shares else []))
    if len(by_share) > _MOST_SETTINGS:
        table.caption = Text(f"and {len(by_share) - _MOST_SETTINGS} that mattered less")
    Console().print(table)


def toml_lines(
    figures: TunedFigures, trials: Sequence[Trial], data: TuningData, found_by: str, seed: int, has_descriptors: bool
) -> list[str]:
    """What the first lines of the file of settings say: where they come from; ``found_by``: whose detections."""
    best = max(range(len(trials)), key=lambda number: trials[number].score)
    name, (before, after) = figures.objective.upper(), figures.searched
    fits = ["match_threshold fits the descriptors of this model only."] if has_descriptors else []
    return [
        f"Found by `lookonce tune` with {found_by}: {name}, trial {best} of {len(trials)}, seed {seed}.",
        f"{data.in_words}. Searched: {name} {100 * before:.2f} -> {100 * after:.2f}; {figures.in_words}.",
        *fits,
    ]
