"""The other trackers that a benchmark is asked for."""

from __future__ import annotations

import argparse

from lookonce.compare.contenders.registry import CROPS, Contender, contenders


def chosen_others(parser: argparse.ArgumentParser, names: list[str]) -> dict[str, Contender]:
    """The trackers of ``lookonce compare`` with these names; ends the program where one is unknown or not installed."""
    known = contenders()
    if unknown := [name for name in names if name == CROPS or name not in known]:
        others = ", ".join(name for name in known if name != CROPS)
        parser.error(f"--trackers {' '.join(unknown)}: expected of {others}")
    if missing := [name for name in names if not known[name].is_installed]:
        parser.error(f"--trackers {' '.join(missing)}: not installed; pip install 'lookonce[compare]'")
    return {name: known[name] for name in names}
