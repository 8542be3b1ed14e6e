"""Settings from TOML: names and types are checked, and every fault is one line that names the remedy."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from datasets.making import refusal
from lookonce.config import check_settings, read_settings, setting_types
from lookonce.errors import ConfigError, FormatError


@dataclass(frozen=True)
class Settings:
    count: int = 1
    rate: float = 0.5
    name: str = "a"
    is_fast: bool = False


@dataclass(frozen=True)
class Inner:
    share: float = 0.1
    hits: int = 2


@dataclass(frozen=True)
class Nested:
    count: int = 1
    inner: Inner = Inner()


def write(folder, content: str | bytes):
    path = folder / "settings.toml"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def test_values_are_read_by_name(tmp_path):
    path = write(tmp_path, 'count = 3\nrate = 1e-3 # slow\nname = "b"\nis_fast = true\n')
    assert read_settings(path, Settings) == {"count": 3, "rate": 1e-3, "name": "b", "is_fast": True}


def test_what_is_not_named_keeps_its_default(tmp_path):
    assert read_settings(write(tmp_path, ""), Settings) == {}
    assert Settings(**read_settings(write(tmp_path, "count = 2"), Settings)) == Settings(count=2)


def test_a_whole_number_is_a_number(tmp_path):
    found = read_settings(write(tmp_path, "rate = 2"), Settings)
    assert found == {"rate": 2.0}
    assert isinstance(found["rate"], float)


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        pytest.param("cuont = 1", ["'cuont'", "did you mean count?"], id="misspelt"),
        pytest.param("zebra = 1", ["'zebra'", "count, rate, name, is_fast"], id="unknown"),
        pytest.param("[fit]\ncount = 1", ["'fit'"], id="table"),
        pytest.param("count = 1.5", ["count = 1.5", "a whole number"], id="fraction"),
        pytest.param("count = true", ["count = True", "a whole number"], id="bool for int"),
        pytest.param('rate = "fast"', ["rate = fast", "a number"], id="text for number"),
        pytest.param("rate = true", ["a number"], id="bool for float"),
        pytest.param("rate = 2024-01-01", ["a number"], id="date"),
        pytest.param(f"rate = 1{'0' * 400}", ["a number"], id="too large for a float"),
        pytest.param("name = 3", ["a text"], id="number for text"),
        pytest.param("is_fast = 1", ["true or false"], id="int for bool"),
        pytest.param("count = [1]", ["a whole number"], id="list"),
        pytest.param('"a\\nb" = 1', ["unknown setting"], id="line break in a name"),
        pytest.param('count = "a\\nb\\u001b[31m"', ["a whole number"], id="control characters in a value"),
        pytest.param(f"{'a' * 5000} = 1", ["unknown setting"], id="long name"),
    ],
)
def test_wrong_names_and_types_are_one_line(tmp_path, content, parts):
    message = refusal(ConfigError, lambda: read_settings(write(tmp_path, content), Settings))
    assert "settings.toml" in message
    assert len(message) < len(str(tmp_path)) + 250
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    "content",
    [
        pytest.param("count 1", id="no equals sign"),
        pytest.param("count = ", id="no value"),
        pytest.param("count = 1\ncount = 2", id="twice"),
        pytest.param("a = " + "[" * 5000, id="deep"),
        pytest.param("count = " + "1" * 5000, id="too many digits"),
        pytest.param("count = 1\x00", id="zero byte"),
        pytest.param('name = "' + "\u2028" * 3, id="no end of a text"),
    ],
)
def test_what_is_not_toml_is_one_line(tmp_path, content):
    message = refusal(FormatError, lambda: read_settings(write(tmp_path, content), Settings))
    assert "settings.toml" in message
    assert "not TOML" in message


@pytest.mark.parametrize("kind", ["missing", "folder", "binary", "huge"])
def test_files_that_cannot_be_read_are_one_line(tmp_path, kind):
    path = tmp_path / "settings.toml"
    if kind == "folder":
        path.mkdir()
    elif kind == "binary":
        path.write_bytes(b"\xff\xfe\x00")
    elif kind == "huge":
        path.write_bytes(b"#" * (2 << 20))
    assert "settings.toml" in refusal(ConfigError, lambda: read_settings(path, Settings))


def test_a_file_whose_limit_falls_into_a_letter_is_too_large(tmp_path):
    """The first bytes alone would have been taken for no text."""
    path = write(tmp_path, b"#" * (1 << 20) + "ä".encode())
    assert "larger than" in refusal(ConfigError, lambda: read_settings(path, Settings))


def test_a_dataclass_inside_is_a_table(tmp_path):
    path = write(tmp_path, "count = 2\n[inner]\nshare = 1\n")
    assert read_settings(path, Nested) == {"count": 2, "inner": {"share": 1.0}}
    assert read_settings(write(tmp_path, "inner.hits = 3"), Nested) == {"inner": {"hits": 3}}
    assert read_settings(write(tmp_path, "[inner]"), Nested) == {"inner": {}}
    assert setting_types(Nested) == {"count": int, "inner.share": float, "inner.hits": int}


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        pytest.param("[inner]\nshaer = 1", ["'inner.shaer'", "did you mean inner.share?"], id="misspelt"),
        pytest.param("share = 1", ["'share'", "did you mean inner.share?"], id="outside its table"),
        pytest.param("inner = 1", ["inner = 1", "expected a table [inner]"], id="no table"),
        pytest.param("[[inner]]\nshare = 1", ["expected a table [inner]"], id="list of tables"),
        pytest.param("[inner]\nhits = 1.5", ["inner.hits = 1.5", "a whole number"], id="type"),
        pytest.param("[inner.share]\nx = 1", ["inner.share", "a number"], id="table for a number"),
        pytest.param("[count]\nx = 1", ["count", "a whole number"], id="table for a plain setting"),
        pytest.param('"inner.share" = 1', ["'inner.share'", "tables"], id="dot in quotes"),
        pytest.param('[inner]\n"inner.share" = 1', ["'inner.inner.share'", "tables"], id="dot in quotes in a table"),
    ],
)
def test_what_is_wrong_in_a_table_is_one_line_with_its_full_name(tmp_path, content, parts):
    message = refusal(ConfigError, lambda: read_settings(write(tmp_path, content), Nested))
    for part in ("settings.toml", *parts):
        assert part in message


def test_values_from_elsewhere_are_checked_alike():
    assert check_settings("--set", {"inner": {"share": 2}}, Nested) == {"inner": {"share": 2.0}}
    assert refusal(ConfigError, lambda: check_settings("--set", {"x": 2}, Nested)).startswith(
        "--set: unknown setting 'x'"
    )
