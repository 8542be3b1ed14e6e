"""The shape of the package: who may import whom, and how long a function and a file may be.

Every import statement counts, also inside functions and under ``TYPE_CHECKING``.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "src" / "lookonce"
OURS = "lookonce"

# in this order: each may import earlier ones
LEAVES = (
    "errors",
    "boxes",
    "distances",
    "letterbox",
    "stories",
    "structures",
    "config",
    "interrupts",
    "assignment",
    "array_file",
)
EXTRA = {"letterbox": {"av"}, "assignment": {"lap"}}

# room -> ours, third party; "make.darknet" is a room inside a room, and the longest name that fits counts
ROOMS: dict[str, tuple[set[str], set[str]]] = {
    leaf: (set(LEAVES[:number]), {"numpy"} | EXTRA.get(leaf, set())) for number, leaf in enumerate(LEAVES)
} | {
    "": ({*LEAVES, "model", "pipeline", "tracking", "video"}, set()),  # the public names
    "video": ({*LEAVES}, {"av", "numpy"}),
    "models": ({*LEAVES}, {"platformdirs"}),
    "model": ({*LEAVES, "models"}, {"numpy", "onnxruntime"}),
    "camera": ({*LEAVES}, {"numpy"}),
    "tracking": ({*LEAVES}, {"numpy"}),
    "output": ({*LEAVES, "video"}, {"numpy", "PIL", "av", "pyarrow"}),
    "datasets": ({*LEAVES, "video"}, {"numpy", "PIL", "defusedxml"}),
    "synthetic": ({*LEAVES, "video", "datasets"}, {"numpy", "PIL"}),
    "evaluation": ({*LEAVES, "datasets"}, {"lap", "numpy"}),
    "pipeline": ({*LEAVES, "camera", "video", "model", "tracking", "output"}, {"numpy"}),
    "demo": (
        {*LEAVES, "video", "model", "tracking", "pipeline", "output", "evaluation", "synthetic"},
        {"numpy", "PIL"},
    ),
    "make": (
        {*LEAVES, "datasets", "video", "model", "evaluation"},
        {"numpy", "torch", "onnx", "onnx_ir", "onnxscript", "safetensors"},
    ),
    "cli": (
        {*LEAVES, "", "video", "model", "models", "tracking", "pipeline", "output", "datasets", "evaluation", "make"},
        {"numpy", "typer", "rich"},
    ),
}
# inside `make`: a graph is written for any network, so `export` knows no Darknet
ROOMS["make.export"] = ROOMS["make"]
ROOMS["cli"][0].update({"make.darknet", "make.export", "make.probing"})
ROOMS["make.darknet"] = (ROOMS["make"][0] | {"make.export"}, ROOMS["make"][1])
ROOMS["make.descriptors"] = ROOMS["make.darknet"]
ROOMS["make.training"] = (
    ROOMS["make"][0] | {"make.export", "make.descriptors", "synthetic"},
    ROOMS["make"][1] | {"PIL", "matplotlib"},
)
ROOMS["__main__"] = ({"cli"}, set())
ROOMS["cli"][0].update({"demo", "make.training"})
ROOMS["cli"][0].add("synthetic")
ROOMS["report"] = ({*LEAVES, "datasets", "evaluation", "video", "model"}, {"numpy", "PIL"})
ROOMS["cli"][0].add("report")
ROOMS["make.detector"] = (
    ROOMS["make"][0] | {"make.darknet", "make.training"},
    ROOMS["make"][1] | {"PIL", "lightning_fabric"},
)
ROOMS["cli"][0].add("make.detector")
ROOMS["make.probing"] = (
    ROOMS["make"][0] | {"make.export", "make.descriptors"},
    ROOMS["make"][1] | {"matplotlib", "PIL"},
)
# trackers held against each other; those of others are imported inside functions
ROOMS["compare"] = (
    {*LEAVES, "camera", "datasets", "evaluation", "tracking", "model", "pipeline", "video", "output"},
    {"numpy", "PIL", "ortools", "similari", "stonesoup", "supervision", "trackers"},
)
ROOMS["make.crops"] = (
    ROOMS["make"][0] | {"make.export", "make.descriptors", "make.training", "compare"},
    ROOMS["make"][1],
)
ROOMS["cli"][0].update({"compare", "make.crops"})
# descriptors at the boxes of others, for people without PyTorch
ROOMS["make.given_boxes"] = ({*LEAVES, "model", "models", "make.export", "make.descriptors"}, {"numpy"})
ROOMS["cli"][0].add("make.given_boxes")
ROOMS[""][0].update({"camera", "make.given_boxes"})
# a tracker's settings searched on detections at hand
ROOMS["tuning"] = (
    {*LEAVES, "compare", "evaluation", "tracking"},
    {"numpy", "optuna"},
)
ROOMS["cli"][0].add("tuning")

FORBIDDEN_FILES = {"utils.py", "util.py", "misc.py", "helpers.py", "helper.py", "common.py"}
MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 60


def _room_of(module: str) -> str:
    """The room of a module given without the package's name: ``make.darknet.cfg`` is in ``make.darknet``."""
    parts = module.split(".")
    for length in range(len(parts), 0, -1):
        if ".".join(parts[:length]) in ROOMS:
            return ".".join(parts[:length])
    return "" if module == "" else parts[0]


def _imports(module: str, is_package: bool, tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and full name of everything that a module imports; relative ones are resolved."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = [OURS, *module.split(".")] if module else [OURS]
                kept = parts[: len(parts) - node.level + is_package]
                base = ".".join([*kept, *([node.module] if node.module else [])])
            for alias in node.names:
                is_room = base == OURS and alias.name in ROOMS  # from lookonce import video
                yield node.lineno, f"{base}.{alias.name}" if is_room else base


def import_violations(sources: Mapping[str, str]) -> list[str]:
    """What breaks the table in a package given as relative path -> source."""
    found = []
    for path, source in sources.items():
        parts = list(Path(path).with_suffix("").parts)
        is_package = parts[-1] == "__init__"
        module = ".".join(parts[:-1] if is_package else parts)
        room = _room_of(module)
        if room not in ROOMS:
            found.append(f"{path}: room '{room}' is not in the table")
            continue
        ours, others = ROOMS[room]
        for line, name in _imports(module, is_package, ast.parse(source)):
            top, _, rest = name.partition(".")
            if top == OURS:
                target = _room_of(rest)
                if target != room and target not in ours:
                    found.append(f"{path}:{line}: '{room}' imports '{target}'")
            elif top not in sys.stdlib_module_names and top not in others:
                found.append(f"{path}:{line}: '{room}' imports {top}")
    return found


def dynamic_imports(sources: Mapping[str, str]) -> list[str]:
    """Calls that import by a name the table cannot see; the package's own front door needs one."""
    names = {"import_module", "__import__"}
    return [
        f"{path}:{node.lineno}"
        for path, source in sources.items()
        if path != "__init__.py"
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Call) and (getattr(node.func, "id", None) or getattr(node.func, "attr", "")) in names
    ]


def size_violations(sources: Mapping[str, str]) -> list[str]:
    """Files and functions (without their docstrings) that are too long, and files named for nothing."""
    found = []
    for path, source in sources.items():
        if Path(path).name in FORBIDDEN_FILES:
            found.append(f"{path}: a name that says nothing")
        if (lines := len(source.splitlines())) > MAX_FILE_LINES:
            found.append(f"{path}: {lines} lines")
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                length = (node.end_lineno or 0) - node.lineno + 1
                if ast.get_docstring(node) is not None:
                    length -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
                if length > MAX_FUNCTION_LINES:
                    found.append(f"{path}:{node.lineno}: {node.name} has {length} lines")
    return found


@pytest.fixture(scope="module")
def sources():
    found = {path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    assert {"__init__.py", "errors.py", "pipeline.py", "make/darknet/cfg.py", "cli/app.py"} <= found.keys()
    return found


def test_imports_go_the_ways_of_the_table(sources):
    assert import_violations(sources) == []


def test_nothing_is_imported_behind_the_tables_back(sources):
    assert dynamic_imports(sources) == []


def test_files_and_functions_are_short(sources):
    assert size_violations(sources) == []


@pytest.mark.parametrize(
    ("path", "source", "expected"),
    [
        pytest.param("tracking/a.py", "import lookonce.video", "'tracking' imports 'video'", id="other-room"),
        pytest.param(
            "tracking/a.py", "from lookonce.video.open import x", "'tracking' imports 'video'", id="submodule"
        ),
        pytest.param(
            "tracking/a.py", "from lookonce import video", "'tracking' imports 'video'", id="from-the-package"
        ),
        pytest.param("tracking/a.py", "from ..video import x", "'tracking' imports 'video'", id="relative"),
        pytest.param(
            "tracking/__init__.py", "from ..video import x", "'tracking' imports 'video'", id="relative-package"
        ),
        pytest.param("tracking/a.py", "from lookonce import track", "'tracking' imports ''", id="public-names"),
        pytest.param("model/a.py", "def f():\n    import torch", "'model' imports torch", id="inside-a-function"),
        pytest.param(
            "video/a.py",
            "if TYPE_CHECKING:\n    from lookonce.model import Model",
            "imports 'model'",
            id="type-checking",
        ),
        pytest.param("model/a.py", "import onnx", "'model' imports onnx", id="onnx-at-run-time"),
        pytest.param("pipeline.py", "from lookonce.cli import app", "'pipeline' imports 'cli'", id="cli"),
        pytest.param(
            "make/training/a.py", "import lookonce.cli.app", "'make.training' imports 'cli'", id="cli-from-make"
        ),
        pytest.param("pipeline.py", "import lookonce.make.export", "imports 'make.export'", id="make-from-run"),
        pytest.param(
            "make/export/a.py", "from lookonce.make.darknet import cfg", "imports 'make.darknet'", id="export"
        ),
        pytest.param("evaluation/a.py", "import lookonce.tracking", "imports 'tracking'", id="evaluation"),
        pytest.param("boxes.py", "from lookonce.structures import Track", "imports 'structures'", id="later-leaf"),
        pytest.param("structures.py", "import scipy", "'structures' imports scipy", id="leaf-with-scipy"),
        pytest.param("boxes.py", "import av", "'boxes' imports av", id="av-outside-letterbox"),
        pytest.param("tracking/a.py", "import cv2", "'tracking' imports cv2", id="opencv"),
        pytest.param("strange/a.py", "", "room 'strange' is not in the table", id="new-room"),
    ],
)
def test_planted_violation_is_found(path, source, expected):
    (found,) = import_violations({path: source})
    assert expected in found
    assert found.startswith(path)


@pytest.mark.parametrize(
    ("path", "source"),
    [
        pytest.param(
            "tracking/a.py", "import os\nimport numpy.typing\nfrom lookonce.tracking.b import x", id="own-room"
        ),
        pytest.param("tracking/a.py", "from .b import x\nfrom ..errors import y", id="relative"),
        pytest.param("make/darknet/a.py", "import torch\nfrom lookonce.make.export.graph import x", id="make"),
        pytest.param("letterbox.py", "import av\nfrom lookonce.boxes import clip", id="letterbox"),
        pytest.param("cli/a.py", "from lookonce import __version__\nimport typer", id="cli"),
    ],
)
def test_allowed_import_is_no_violation(path, source):
    assert import_violations({path: source}) == []


def test_planted_sizes_names_and_hidden_imports_are_found():
    long = "def f():\n" + "    x = 1\n" * 60
    documented = 'def f():\n    """One.\n' + "\n" * 30 + '    """\n' + "    x = 1\n" * 59
    assert size_violations({"a.py": long}) == ["a.py:1: f has 61 lines"]
    assert size_violations({"a.py": documented}) == []
    assert size_violations({"a.py": "x = 1\n" * 401}) == ["a.py: 401 lines"]
    assert size_violations({"a.py": "x = 1\n" * 400}) == []
    assert size_violations({"video/utils.py": ""}) == ["video/utils.py: a name that says nothing"]
    assert dynamic_imports({"a.py": "import importlib\nimportlib.import_module('torch')"}) == ["a.py:2"]
    assert dynamic_imports({"a.py": "__import__('torch')", "__init__.py": "import_module('a')"}) == ["a.py:1"]
