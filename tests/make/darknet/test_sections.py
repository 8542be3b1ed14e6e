"""Cfg text as sections: what is read, and that every wrong line is named."""

from __future__ import annotations

import pytest

from lookonce.errors import FormatError
from lookonce.make.darknet.sections import Section, read_sections


def _section(**options: str) -> Section:
    return Section("a.cfg", "yolo", 7, {key: (value, 8 + n) for n, (key, value) in enumerate(options.items())})


def test_sections_keep_their_order_names_and_lines(tmp_path):
    path = tmp_path / "a.cfg"
    path.write_text("# a comment\n[Net]\nwidth = 32  # px\n\n; another\n[conv]\n[conv]\n size=1;x\n", encoding="utf-8")
    first, second, third = read_sections(path)
    assert [(s.name, s.line) for s in (first, second, third)] == [("net", 2), ("conv", 6), ("conv", 7)]
    assert (first.options, second.options, third.options) == ({"width": ("32", 3)}, {}, {"size": ("1", 8)})


def test_windows_line_ends_are_read(tmp_path):
    path = tmp_path / "a.cfg"
    path.write_bytes(b"[net]\r\nwidth=32\r\n")
    assert read_sections(path)[0].options == {"width": ("32", 2)}


@pytest.mark.parametrize(
    ("content", "line", "message"),
    [
        pytest.param(b"", 0, "no [section] found", id="empty"),
        pytest.param(b"# only a comment\n\n", 0, "no [section] found", id="only-comments"),
        pytest.param(b"[net]\n\xff\xfe\x00\x81", 0, "not text", id="binary"),
        pytest.param(b"width=32\n[net]\n", 1, "before the first [section]", id="key-before-section"),
        pytest.param(b"[net]\nwidth=32\nheight=32\nwidth=32\n", 4, "'width' is given twice", id="key-twice"),
        pytest.param(b"[net]\nwidth 32\n", 2, "expected key=value, got 'width 32'", id="no-equals"),
        pytest.param(b"[net]\n=32\n", 2, "expected key=value", id="no-key"),
        pytest.param(b"[net]\nwidth=\n", 2, "expected key=value", id="no-value"),
        pytest.param(b"[net]\n[conv\n", 2, "expected a section like [convolutional]", id="open-bracket"),
        pytest.param(b"[net]\n[" + b"x" * 100 + b"]", 2, "expected a section like", id="endless-name"),
        pytest.param(b"[c]\n" * 2001, 2001, "more than 2000 sections", id="too-many-sections"),
        pytest.param(b"#" * ((1 << 20) + 1), 0, "larger than", id="too-large"),
    ],
)
def test_wrong_text_is_refused_with_path_and_line(tmp_path, content, line, message):
    path = tmp_path / "wrong.cfg"
    path.write_bytes(content)
    with pytest.raises(FormatError) as caught:
        read_sections(path)
    assert (caught.value.path, caught.value.line) == (str(path), line)
    assert str(caught.value).startswith(f"{path}:{line}: " if line else f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_and_folder_are_named(tmp_path):
    for path in (tmp_path / "nothing.cfg", tmp_path):
        with pytest.raises(FormatError, match="cannot read the cfg file") as caught:
            read_sections(path)
        assert str(path) in str(caught.value)


def test_values_are_read_by_kind_with_defaults():
    section = _section(size="3", name="leaky", ratio="0.5", many="1, 2 ,3,", real="1.5,2")
    assert (section.integer("size", 1, 0, 9), section.integer("absent", 4, 0, 9)) == (3, 4)
    assert (section.number("ratio", 1.0, 0, 1), section.number("absent", 1.0, 0, 1)) == (0.5, 1.0)
    assert section.choice("name", "linear", ("leaky", "linear")) == "leaky"
    assert section.integers("many", 0, 9) == (1, 2, 3)
    assert section.numbers("real", 0, 9) == (1.5, 2.0)
    section.finish(())


@pytest.mark.parametrize(
    ("read", "message"),
    [
        pytest.param(lambda s: s.integer("n", None, 0, 9), "n=12: expected 0 to 9", id="above"),
        pytest.param(lambda s: s.integer("n", None, 13, 20), "n=12: expected 13 to 20", id="below"),
        pytest.param(lambda s: s.integer("word", None, 0, 9), "word=big: expected a whole number", id="word"),
        pytest.param(lambda s: s.integer("real", None, 0, 9), "real=1.5: expected a whole number", id="fraction"),
        pytest.param(lambda s: s.number("word", 0, 0, 9), "word=big: expected a number", id="no-number"),
        pytest.param(lambda s: s.number("nan", 0, 0, 9), "nan=nan: expected 0 to 9", id="nan"),
        pytest.param(lambda s: s.number("inf", 0, 0, float("inf")), "inf=1e999: expected", id="infinite"),
        pytest.param(lambda s: s.integer("huge", None, 0, 9), "huge=999", id="thousands-of-digits"),
        pytest.param(lambda s: s.choice("word", "a", ("a", "b")), "word=big: expected one of a, b", id="choice"),
        pytest.param(lambda s: s.integers("commas", 0, 9), "commas", id="empty-list-item"),
        pytest.param(lambda s: s.integers("comma", 0, 9), "comma=: expected a whole number", id="empty-list"),
        pytest.param(lambda s: s.integers("long", 0, 9), "expected 1 to 1000 values, got 1001", id="long-list"),
    ],
)
def test_wrong_value_names_its_line(read, message):
    options = {"n": "12", "word": "big", "real": "1.5", "nan": "nan", "inf": "1e999", "huge": "9" * 5000}
    options |= {"commas": "1,,2", "comma": ",", "long": "1," * 1001}
    section = _section(**options)
    with pytest.raises(FormatError) as caught:
        read(section)
    assert message in str(caught.value)
    key = message.split("=")[0] if "=" in message else None
    assert caught.value.line == (section.options[key][1] if key else caught.value.line) >= 8
    assert len(str(caught.value)) < 200


def test_needed_key_that_is_absent_names_the_section():
    with pytest.raises(FormatError, match=r"^a\.cfg:7: \[yolo\] needs the key 'from'$"):
        _section().integer("from", None, 0, 9)


def test_unread_key_is_unknown_and_near_names_are_offered():
    section = _section(filters="1", fliters="2")
    section.integer("filters", None, 0, 9)
    with pytest.raises(FormatError, match=r"^a\.cfg:9: \[yolo\] unknown key 'fliters'; did you mean filters\?$"):
        section.finish(())
    section.finish(("fliters",))
