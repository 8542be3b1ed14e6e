"""docs/ua-detrac.md: its commands, as the page shows them, on a small set in UA-DETRAC's layout.

The pictures show coloured squares instead of vehicles, and the detector of squares.py goes under YOLOv3's name. Of the
commands only the class names differ, since that detector knows two; training is kept short by a settings file.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.main import get_command

from lookonce.cli.app import app
from lookonce.model import describe_model
from squares import CELL, COLOURS, write_darknet

PAGE = Path(__file__).parents[1] / "docs" / "ua-detrac.md"
TRAIN = ("MVI_20011", "MVI_20012", "MVI_20032", "MVI_20033", "MVI_20034")
TEST = ("MVI_39031", "MVI_39051")
TRAIN_FRAMES, TEST_FRAMES = 6, 21
HEIGHT, WIDTH = 352, 608  # the input that the page chooses, so that squares stay on the detector's cells
ROWS = {"red": 10, "green": 20, "blue": 33}
KINDS = ("compact", "paper")
SHORT_RUN = "steps = 6\ncheck_every = 3\n"
COMMAND = f"""#!/bin/sh
if [ "$1" = fit ]; then set -- "$@" --config short.toml; fi
exec "{sys.executable}" -c "from lookonce.cli.app import main; main()" "$@"
"""


def column_of(name: str, frame: int, start: int) -> int:
    """The cell column of a square: one cell further each frame, green the other way round."""
    return (start + (frame if name != "green" else -frame)) % (WIDTH // CELL)


def draw(frame: int, start: int) -> Image.Image:
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    for name, row in ROWS.items():
        left = column_of(name, frame, start) * CELL
        image[row * CELL : (row + 1) * CELL, left : left + CELL] = COLOURS[name]
    return Image.fromarray(image)


def target(identity: int, left: int, top: int) -> str:
    return f"""
         <target id="{identity}">
            <box left="{left}" top="{top}" width="{CELL}" height="{CELL}"/>
            <attribute orientation="18.488" speed="6.859" trajectory_length="5" truncation_ratio="0.1" \
vehicle_type="car"/>
            <occlusion>
               <region_overlap left="{left}" top="{top}" width="1" height="1" occlusion_id="9" occlusion_status="1"/>
            </occlusion>
         </target>"""


def annotation(name: str, frames: int, start: int) -> str:
    """The XML of a sequence, with all that real ones have."""
    parts = []
    for frame in range(frames):
        places = [(column_of(colour, frame, start) * CELL, row * CELL) for colour, row in ROWS.items()]
        targets = "".join(target(number, *place) for number, place in enumerate(places, 1))
        parts.append(
            f'\n   <frame density="{len(ROWS)}" num="{frame + 1}">\n      <target_list>{targets}\n'
            "      </target_list>\n   </frame>"
        )
    return (
        f'<?xml version="1.0" encoding="utf-8"?>\n<sequence name="{name}">\n'
        '   <sequence_attribute camera_state="unstable" sence_weather="sunny"/>\n   <ignored_region>\n'
        '      <box left="300.75" top="0.5" width="181.75" height="63.5"/>\n'
        f"   </ignored_region>{''.join(parts)}\n</sequence>"
    )


def write_detrac(root: Path) -> None:
    """The four folders as distributed, with few and small sequences."""
    for part, names, frames in (("Train", TRAIN, TRAIN_FRAMES), ("Test", TEST, TEST_FRAMES)):
        annotations = root / f"DETRAC-{part}-Annotations-XML"
        annotations.mkdir(parents=True)
        for number, name in enumerate(names):
            (annotations / f"{name}.xml").write_text(annotation(name, frames, 7 * number))
            pictures = root / f"Insight-MVT_Annotation_{part}" / name
            pictures.mkdir(parents=True)
            for frame in range(frames):
                draw(frame, 7 * number).save(pictures / f"img{frame + 1:05d}.jpg", quality=95, subsampling=0)


def commands() -> list[str]:
    """The page's code blocks that are meant for a shell."""
    return re.findall(r"^```sh\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def run(block: str, folder: Path) -> str:
    environment = {**os.environ, "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}", "NO_COLOR": "1"}
    script = block.replace("car,bus,truck", "car,truck")
    result = subprocess.run(["sh", "-euc", script], cwd=folder, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, f"{script}\n{result.stdout}\n{result.stderr}"
    return result.stdout


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which all commands of the page were run, from top to bottom."""
    folder = tmp_path_factory.mktemp("recipe")
    write_detrac(folder / "DETRAC")
    cfg, weights, names = write_darknet(folder)
    cfg.rename(folder / "yolov3.cfg")
    weights.rename(folder / "yolov3.weights")
    names.unlink()
    (folder / "coco.names").write_text("car\ntruck\n")
    (folder / "short.toml").write_text(SHORT_RUN)
    (folder / "bin").mkdir()
    (folder / "bin" / "lookonce").write_text(COMMAND)
    (folder / "bin" / "lookonce").chmod(0o755)
    for block in commands():
        run(block, folder)
    return folder


def model_file(folder: Path, kind: str) -> Path:
    return folder / ("yolov3+id.onnx" if kind == "compact" else "yolov3+paper.onnx")


def test_page_shows_every_step_with_options_that_exist() -> None:
    lines = "".join(commands()).replace("\\\n", "").splitlines()
    shown = [words[1:] for words in map(shlex.split, lines) if words[0] == "lookonce"]
    assert [step for step, *_ in shown] == ["import", "fit", "probe", "track", "fit", "probe", "track"]
    known = get_command(app).commands
    for step, *arguments in shown:
        known[step].make_context(step, arguments)  # raises for what it does not know


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_model_file_has_calibrated_descriptors_of_the_kind(finished: Path, kind: str) -> None:
    descriptor = describe_model(model_file(finished, kind)).descriptor
    assert descriptor is not None
    assert descriptor.kind == kind
    assert descriptor.match_threshold is not None


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_record_names_the_training_sequences_and_a_whole_held_out_one(finished: Path, kind: str) -> None:
    folder = model_file(finished, kind).with_suffix(".fit")
    record = json.loads((folder / "record.json").read_text())
    assert sorted(name.split()[-1] for name in record["data"]) == list(TRAIN)
    assert record["settings"]["kind"] == kind
    assert record["identities"] == (len(TRAIN) - 1) * len(ROWS)
    assert record["validation"]["identities"] == len(ROWS)
    assert {"model", "history", "seconds", "versions"} <= record.keys()
    files = {path.name for path in folder.iterdir()}
    assert files == {"record.json", "run.json", "curves.png", "checkpoint.safetensors"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_probe_describes_the_test_sequences(finished: Path, kind: str) -> None:
    folder = finished / "results" / f"probe-{kind}"
    assert {path.name for path in folder.iterdir()} == {"probe.json", "neighbours.png", "distances.png"}
    text = (folder / "probe.json").read_text()
    assert all(name in text for name in TEST)
    assert not any(name in text for name in TRAIN)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("number", range(len(TEST)))
def test_every_test_sequence_has_tracks_that_follow_its_squares(finished: Path, kind: str, number: int) -> None:
    lines = (finished / "results" / kind / TEST[number] / "tracks.txt").read_text().splitlines()
    rows = np.array([line.split(",") for line in lines], np.float64)
    assert len(rows) == TEST_FRAMES * len(ROWS)
    identities: dict[str, set[int]] = defaultdict(set)
    for frame, identity, left, top in rows[:, :4].tolist():
        (name,) = (name for name, row in ROWS.items() if round(top) == row * CELL)
        assert round(left) == column_of(name, int(frame) - 1, 7 * number) * CELL
        identities[name].add(int(identity))
    assert [len(identities[name]) for name in ROWS] == [1, 1, 1]
