"""The annotation XML of UA-DETRAC, read in one pass with bounded memory; hostile until it is checked."""

from __future__ import annotations

from array import array
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax import SAXParseException
from xml.sax.handler import ContentHandler
from xml.sax.xmlreader import AttributesImpl, Locator

from defusedxml.common import DefusedXmlException
from defusedxml.expatreader import DefusedExpatParser

from lookonce.datasets.class_names import check_class_name
from lookonce.datasets.text import LARGEST_WHOLE, MAX_FILE_BYTES, MAX_ROWS, check_size, fault, quoted
from lookonce.datasets.truth import NO_IDENTITY
from lookonce.errors import FormatError

__all__ = ["ROW_LENGTH", "Annotation", "read_annotation"]

ROW_LENGTH = 9
_CHUNK_BYTES = 1 << 16
_MAX_QUIET_BYTES = 1_000_000  # of text, comments or attributes without an element; real files have one in 300 bytes
_MAX_DEPTH = 16  # UA-DETRAC needs 6
_MAX_TEXT = 200  # characters of an attribute


@dataclass(slots=True)
class Annotation:
    """What the file says.

    Attributes:
        name: of the sequence; "" where it has none.
        rows: ROW_LENGTH numbers an object: frame (from 1), id, class, left, top, right, bottom, visibility, line.
        frames: the numbers of the frames, from 1.
        types: vehicle types; an object's class is an index into them.
        ignored: 5 numbers a region: left, top, right, bottom, line.
        left_out: why -> objects.
    """

    name: str = ""
    rows: array[float] = field(default_factory=lambda: array("d"))
    frames: array[int] = field(default_factory=lambda: array("q"))
    types: dict[str, int] = field(default_factory=dict)
    ignored: array[float] = field(default_factory=lambda: array("d"))
    left_out: Counter[str] = field(default_factory=Counter)


@dataclass(slots=True)
class _Target:
    """An object while its element is open."""

    identity: int
    line: int
    box: tuple[float, float, float, float] | None = None
    label: int | None = None
    hidden_px: float = 0.0  # area


class _Handler(ContentHandler):
    """Collects an ``Annotation`` from the elements as they come; elements that it does not know are skipped."""

    def __init__(self, path: Path, where: Locator) -> None:
        super().__init__()
        self.annotation = Annotation()
        self.elements = 0
        self._path = path
        self._where = where
        self._open: list[str] = []
        self._frame: int | None = None
        self._target: _Target | None = None
        self._starts = {
            ("sequence", "frame"): self._start_frame,
            ("ignored_region", "box"): self._add_ignored,
            ("target_list", "target"): self._start_target,
            ("target", "box"): self._set_box,
            ("target", "attribute"): self._set_label,
            ("occlusion", "region_overlap"): self._add_overlap,
        }

    @property
    def line(self) -> int:
        """The line where the parser is."""
        return self._where.getLineNumber() or 0

    def error(self, message: str) -> FormatError:
        """The error for the place where the parser is."""
        return fault(self._path, self.line, message)

    def startElement(self, name: str, attrs: AttributesImpl) -> None:
        """Takes an element's attributes."""
        self.elements += 1
        parent = self._open[-1] if self._open else ""
        if not parent:
            if name != "sequence":
                raise self.error(f"expected <sequence>, got <{quoted(name)[1:-1]}>: not a UA-DETRAC file")
            self.annotation.name = self._text(attrs, name, "name") if "name" in attrs else ""
        if len(self._open) >= _MAX_DEPTH:
            raise self.error(f"elements nested deeper than {_MAX_DEPTH}: not a UA-DETRAC file")
        self._open.append(name)
        start = self._starts.get((parent, name))
        if start is not None:
            start(attrs)

    def endElement(self, name: str) -> None:
        """Keeps an object that is complete."""
        self._open.pop()
        if name == "target" and self._target is not None:
            self._finish_target(self._target)
            self._target = None
        elif name == "frame":
            self._frame = None

    def _text(self, attrs: AttributesImpl, element: str, name: str) -> str:
        text = attrs.get(name)
        if text is None:
            raise self.error(f"<{element}> without {name}; mend the file or get it again")
        if len(text) > _MAX_TEXT:
            raise self.error(f"{name} of <{element}> has more than {_MAX_TEXT} characters: not a UA-DETRAC file")
        return text

    def _number(self, attrs: AttributesImpl, element: str, name: str) -> float:
        text = self._text(attrs, element, name)
        try:
            return float(text)
        except ValueError:
            raise self.error(f"{name} of <{element}>: expected a number, got {quoted(text)}; mend it") from None

    def _whole(self, attrs: AttributesImpl, element: str, name: str) -> int:
        number = self._number(attrs, element, name)
        if not number.is_integer() or abs(number) > LARGEST_WHOLE:
            raise self.error(f"{name} of <{element}>: expected a whole number, got {number:g}; mend it")
        return int(number)

    def _box(self, attrs: AttributesImpl, element: str) -> tuple[float, float, float, float]:
        left, top = self._number(attrs, element, "left"), self._number(attrs, element, "top")
        width, height = self._number(attrs, element, "width"), self._number(attrs, element, "height")
        return left, top, left + width, top + height

    def _start_frame(self, attrs: AttributesImpl) -> None:
        self._frame = self._whole(attrs, "frame", "num")
        if self._frame < 1:
            raise self.error(f"num of <frame>: frames count from 1; expected 1 or more, got {self._frame}")
        self.annotation.frames.append(self._frame)
        if len(self.annotation.frames) > MAX_ROWS:
            raise self.error(f"more than {MAX_ROWS:,} frames; split it into sequences")

    def _add_ignored(self, attrs: AttributesImpl) -> None:
        self.annotation.ignored.extend((*self._box(attrs, "box"), self.line))

    def _start_target(self, attrs: AttributesImpl) -> None:
        if self._frame is None:
            raise self.error("<target> outside a <frame>; mend the file or get it again")
        self._target = _Target(self._whole(attrs, "target", "id"), self.line)

    def _set_box(self, attrs: AttributesImpl) -> None:
        if self._target is not None:
            self._target.box = self._box(attrs, "box")

    def _set_label(self, attrs: AttributesImpl) -> None:
        if self._target is not None:
            text = self._text(attrs, "attribute", "vehicle_type").strip()
            types = self.annotation.types
            self._target.label = types.setdefault(check_class_name(text, self._path, self.line), len(types))

    def _add_overlap(self, attrs: AttributesImpl) -> None:
        if self._target is not None:
            left, top, right, bottom = self._box(attrs, "region_overlap")
            if not (right >= left and bottom >= top):  # also for NaN
                raise self.error("<region_overlap>: expected width and height of 0 or more; mend it")
            self._target.hidden_px += (right - left) * (bottom - top)

    def _finish_target(self, target: _Target) -> None:
        if target.box is None or target.label is None:
            missing = "box" if target.box is None else "attribute"
            raise fault(self._path, target.line, f"<target> without <{missing}>; mend the file or get it again")
        if target.identity < 0:
            self.annotation.left_out[NO_IDENTITY] += 1
            return
        left, top, right, bottom = target.box
        area = (right - left) * (bottom - top)
        visibility = 1 - min(1.0, target.hidden_px / area) if area > 0 else 1.0
        assert self._frame is not None  # or _start_target would have refused it
        row = (self._frame, target.identity, target.label, *target.box, visibility, target.line)
        self.annotation.rows.extend(row)
        if len(self.annotation.rows) > MAX_ROWS * ROW_LENGTH:
            raise self.error(f"more than {MAX_ROWS:,} objects; split it into sequences")


def read_annotation(path: Path) -> Annotation:
    """Reads a ``MVI_*.xml``.

    An object's visibility is 1 less the share of its box that its ``region_overlap`` rectangles cover, as their areas
    add up; ``truncation_ratio`` says something else. Numbers of boxes are not yet checked.

    Raises:
        FormatError: it is missing, too large, no XML, has a DTD or entities, or is no UA-DETRAC annotation.
    """
    parser = DefusedExpatParser(forbid_dtd=True, forbid_entities=True, forbid_external=True)
    handler = _Handler(path, parser)
    parser.setContentHandler(handler)
    try:
        check_size(path, MAX_FILE_BYTES)
        _feed(path, parser, handler)
    except DefusedXmlException as exc:
        raise handler.error("a DTD, an entity or an external reference; UA-DETRAC has none, remove it") from exc
    except SAXParseException as exc:
        message = f"no valid XML ({exc.getMessage()}); is it cut short? Get it again"
        raise fault(path, exc.getLineNumber() or 0, message) from exc
    except OSError as exc:
        raise fault(path, 0, f"cannot be read ({exc.strerror}); check its permissions") from exc
    except (ValueError, LookupError) as exc:  # encodings that expat does not know
        raise handler.error("its text encoding is unknown; save it as UTF-8") from exc
    return handler.annotation


def _feed(path: Path, parser: DefusedExpatParser, handler: _Handler) -> None:
    quiet_bytes = 0
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK_BYTES):
            elements = handler.elements
            parser.feed(chunk)
            quiet_bytes = quiet_bytes + len(chunk) if elements == handler.elements else 0
            if quiet_bytes > _MAX_QUIET_BYTES:
                raise handler.error(f"more than {_MAX_QUIET_BYTES:,} bytes without an element: not a UA-DETRAC file")
    parser.close()
