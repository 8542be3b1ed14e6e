"""What the tests of `lookonce eval` share: small truth, results for it, and the command."""

from __future__ import annotations

from pathlib import Path

from cli.running import Command
from datasets.making import annotation, frame, target, write, write_mot

FRAMES = 10
CAR, BUS = (1, 5, 5, 1), (2, 30, 20, 2)  # id, left, top, class
COMMAND = Command("eval")
run, done, refusal = COMMAND.run, COMMAND.done, COMMAND.refusal


def truth_lines(*, tail: str = "1,{cls},1") -> str:
    lines = []
    for number in range(FRAMES):
        for identity, left, top, cls in (CAR, BUS):
            lines.append(f"{number + 1},{identity},{left + number},{top},12,10,{tail.format(cls=cls)}")
    return "\n".join(lines) + "\n"


def result_lines(*, switch: int = FRAMES, missing: int = FRAMES, classes: bool = False) -> str:
    """The car's id changes at ``switch``, the bus is missed from ``missing`` on; all boxes are 1 px aside."""
    lines = []
    for number in range(FRAMES):
        for identity, left, top, cls in (CAR, BUS):
            if identity == BUS[0] and number >= missing:
                continue
            name = identity + 10 * (identity == CAR[0] and number >= switch)
            last = f"{cls},-1,-1" if classes else "-1,-1,-1"
            lines.append(f"{number + 1},{name},{left + number + 1}.00,{top}.00,12.00,10.00,0.9,{last}")
    return "\n".join(lines) + "\n"


def write_truth(folder: Path) -> Path:
    """Two sequences as CVAT writes them, with the classes car and bus."""
    for name in ("a", "b"):
        write_mot(folder / name, truth_lines(), pictures=FRAMES)
        write(folder / name / "gt" / "labels.txt", "car\nbus\n")
    return folder


def detrac_xml(name: str = "MVI_1") -> str:
    def box(left: int) -> str:
        return f'left="{left}" top="50" width="40" height="30"'

    frames = (frame(n + 1, target(1, box(20 + n)), target(2, box(300), kind="bus")) for n in range(FRAMES))
    return annotation(*frames, name=name, ignored=['left="280" top="0" width="200" height="200"'])


def table_row(stdout: str, name: str) -> list[str]:
    (line,) = (line for line in stdout.splitlines() if line.split()[:1] == [name])
    return line.split()[1:]
