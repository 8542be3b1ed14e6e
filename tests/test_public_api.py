"""The names that users import, and what importing them costs."""

from __future__ import annotations

import importlib
import inspect
import subprocess
import sys

import pytest

import lookonce

PUBLIC = {
    "BoxDescriber",
    "CameraMotion",
    "ConfigError",
    "DefaultConfig",
    "Detections",
    "FormatError",
    "Frame",
    "LookonceError",
    "Model",
    "ModelError",
    "OutputError",
    "PaperConfig",
    "Track",
    "TrackedFrame",
    "Tracker",
    "Tracks",
    "VideoError",
    "WeightsError",
    "__version__",
    "open_video",
    "track",
    "tracker_for",
}
HEAVY = ("numpy", "av", "onnxruntime", "PIL", "scipy", "torch", "onnx", "onnx_ir", "rich", "typer")


def test_public_names_are_exactly_these():
    assert set(lookonce.__all__) == PUBLIC
    assert len(lookonce.__all__) == len(PUBLIC)
    assert list(lookonce.__all__) == sorted(lookonce.__all__)
    assert set(dir(lookonce)) == PUBLIC


@pytest.mark.parametrize("name", sorted(PUBLIC - {"__version__"}))
def test_public_name_is_importable_and_documented(name):
    value = getattr(lookonce, name)
    documentation = inspect.getdoc(value)
    assert documentation
    assert not documentation.startswith(f"{name}(")  # what a dataclass says of itself when nobody wrote anything
    assert value is getattr(importlib.import_module(f"lookonce.{lookonce._HOMES[name]}"), name)
    assert name in importlib.import_module(f"lookonce.{lookonce._HOMES[name]}").__all__


def test_every_public_name_has_a_home_and_nothing_else_has():
    assert set(lookonce._HOMES) == PUBLIC - {"__version__"}


def test_names_for_the_type_checker_are_the_public_ones():
    """They are listed twice, once for Python and once for type checkers."""
    source = inspect.getsource(lookonce)
    block = source[source.index("if TYPE_CHECKING:") : source.index("__version__ =")]
    namespace: dict[str, object] = {}
    exec(inspect.cleandoc(block.split("\n", 1)[1].replace("\n    ", "\n")), namespace)
    assert {name for name in namespace if name != "__builtins__"} == PUBLIC - {"__version__"}


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'lookonce' has no attribute 'trakc'"):
        _ = lookonce.trakc


def test_all_errors_have_one_root():
    for name in PUBLIC:
        if name.endswith("Error"):
            assert issubclass(getattr(lookonce, name), lookonce.LookonceError)
            assert not issubclass(lookonce.LookonceError, ValueError | TypeError | OSError)


def _loaded_after(statement: str) -> set[str]:
    """Top names of the modules that a fresh interpreter holds after a statement."""
    program = f"import sys\n{statement}\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stderr == ""
    return set(done.stdout.split())


def test_importing_the_package_loads_none_of_its_parts():
    loaded = _loaded_after("import lookonce; dir(lookonce)")
    assert "lookonce" in loaded
    assert not loaded & set(HEAVY)


def test_using_the_parts_needs_no_torch():
    names = ", ".join(sorted(PUBLIC))
    loaded = _loaded_after(f"from lookonce import {names}\nimport lookonce.cli.app")
    assert {"numpy", "av", "onnxruntime", "typer"} <= loaded
    assert not loaded & {"torch", "onnx", "onnx_ir", "onnxscript", "scipy", "cv2", "supervision"}
