"""What each part of the preset `default` is good for: the figures with all of them, and what is lost without each.

    python benchmarks/tracker_parts.py
    python benchmarks/tracker_parts.py --case PETS09-S2L1 detections/PETS09-S2L1-0123456789abcdef.npz 0 --draws 2

Each `--case` is a sequence with truth, its detections as `lookonce compare --cache detections` keeps them, its pictures
where they do not lie beside the truth, and the numbers of the classes that count (default: all); protocol `trackeval`,
every 1st, 2nd, 4th and 8th frame, `--draws` as in `tracker_draws.py`. Beside them stand the scripted scenes of
`tracker_regimes.py`, with descriptors and without. `PARTS` says by which settings a part is switched off; what counts
is the mean over cases, frame rates and draws, and of the identity switches the sum.
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookonce.cli.evaluated_truth import open_truth, thin
from lookonce.compare.contenders.presets import associate_by, calibrated
from lookonce.compare.detection_store import read_detections
from lookonce.compare.jobs import select
from lookonce.tracking.settings import choose_tracker
from machine import describe_machine
from tracker_draws import FIGURES, LEAST_SCORE, draw, figures
from tracker_regimes import RATES, REGIMES, make_scene, named_rightly

EVERY = (1, 2, 4, 8)
PARTS = {
    "descriptors": ["appearance=false"],
    "several views": ["views=0"],
    "only clean views": ["clean_overlap=1", "hidden_overlap=1"],
    "a guess without descriptors": ["appearance_absent=0"],
    "safe pairs": ["safe_overlap=1"],
    "second pass, low scores": ["low_overlap=1"],
    "... of objects unseen": ["recent_s=0"],
    "double boxes left out": ["same_overlap=1"],
    "double objects refused": ["duplicate_overlap=1"],
    "limit of place": ["place_limit=1000"],
    "class": ["class_penalty=0"],
    "memory": ["memory_s=1"],
    "end beyond the border": ["leave_s=8"],
    "rows given back": ["given_back_rows=1"],
    "steady boxes": ["steady=false"],
    "filled gaps": ["fill_s=0"],
    "jumps of the picture": ["jolts=false"],
    "doubt": ["motion.doubt=0"],
    "noise by score": ["motion.score_noise=0"],
    "lag": ["motion.lag=1000000"],
    "noise by speed": ["motion.acceleration_share=0"],
    "new ones may be fast": ["motion.jump_share=0"],
    "known ones may turn": ["motion.turn_share=0"],
    "those that are alone": ["motion.alone_speed=0"],
    "unseen ones slow down": ["motion.slow_down_s=1000"],
    "growth": ["motion.growth=0"],
    "evidence: travels": ["evidence.travels=1000000"],
    "evidence: scores": ["evidence.score=0", "evidence.least_score=0"],
    "evidence: score of what moves": ["evidence.least_score=0.7"],
}


@dataclass(frozen=True)
class Options:
    """What to measure on: the cases as given, and so many draws and scripted scenes."""

    cases: tuple[tuple[str, ...], ...]
    draws: int
    scenes: int


def on_cases(changes: list[str], options: Options) -> NDArray[np.float64]:
    """(K, 5) ``FIGURES`` with such settings, of each case, frame rate and draw."""
    chosen, rows = choose_tracker("default", changes), []
    for name, detections, *rest in options.cases:
        labels = tuple(int(word) for word in rest if word.isdigit())
        pictures = [Path(word) for word in rest if not word.isdigit()]
        (true,) = open_truth(Path(name), frames=pictures[0] if pictures else None)
        stored = read_detections(Path(detections)).sequence
        config = chosen.config if chosen.has_threshold else calibrated(chosen.config, stored)
        for every in EVERY:
            truth = thin(true, every).truth
            for number in range(options.draws):
                drawn = select(draw(stored, number), every, LEAST_SCORE, labels)
                rows.append(figures(truth, drawn, associate_by(config, drawn)))
    return np.array(rows).reshape(-1, len(FIGURES))


def on_scripts(changes: list[str], has_looks: bool, scenes: int) -> float:
    """Percentage of the detections that are named rightly with such settings, mean of all scripted scenes."""
    config, shares = choose_tracker("default", changes).config, []
    for regime in REGIMES.values():
        for rate in RATES:
            for seed in range(scenes):
                scene, objects = make_scene(regime, rate, seed, has_looks)
                shares.append(named_rightly(objects, associate_by(config, scene).ids))
    return float(np.mean(shares))


def measure(changes: list[str], options: Options) -> list[float]:
    """The columns of a line of the table."""
    columns = [on_scripts(changes, True, options.scenes), on_scripts(changes, False, options.scenes)]
    if options.cases:
        *shares, switches = on_cases(changes, options).T
        columns += [*(float(share.mean()) for share in shares), float(switches.sum())]
    return columns


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    case_help = "truth, detections, pictures, class numbers; may be repeated"
    parser.add_argument("--case", nargs="+", action="append", default=[], dest="cases", metavar="WHAT", help=case_help)
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--set", action="append", default=[], dest="changes", metavar="NAME=VALUE", help="in all lines")
    parser.add_argument("--draws", type=int, default=1)
    parser.add_argument("--scenes", type=int, default=5, help="of each script")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    if any(len(case) < 2 for case in arguments.cases):
        parser.error("--case: expected a truth and its detections")
    options = Options(tuple(map(tuple, arguments.cases)), arguments.draws, arguments.scenes)
    names = ["scripted", "no looks", *(FIGURES if options.cases else ())]
    print(describe_machine())
    print(f"mean of {len(options.cases)} cases, {options.draws} draws; the lines below the first are differences to it")
    print(f"{'without':32s}" + "".join(f"{name:>10s}" for name in names))
    ways = [arguments.changes, *(arguments.changes + PARTS[part] for part in arguments.parts)]
    with ProcessPoolExecutor(arguments.jobs) as pool:
        answers = pool.map(partial(measure, options=options), ways)
        whole = np.array(next(answers))
        print(f"{'(all parts)':32s}" + "".join(f"{value:10.1f}" for value in whole), flush=True)
        for part, answer in zip(arguments.parts, answers, strict=True):
            print(f"{part:32s}" + "".join(f"{value:+10.1f}" for value in np.array(answer) - whole), flush=True)


if __name__ == "__main__":
    main()
