"""The header of a PLY file: its elements and their encoding."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from spcola.errors import FormatError
from spcola.formats.text.source import whole_number

Encoding = Literal["ascii", "little", "big"]

ENCODINGS: dict[str, Encoding] = {
    "ascii": "ascii",
    "binary_little_endian": "little",
    "binary_big_endian": "big",
}
TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}

_LAST = b"end_header"
_MOST_PROPERTIES = 1000


@dataclass(frozen=True)
class PlyProperty:
    """A property: its name, NumPy type (without byte order), and the type of a list's count."""

    name: str
    kind: str
    count_kind: str | None = None


@dataclass(frozen=True)
class PlyElement:
    """An element: its name, how many there are, and the properties of each.

    Parameters
    ----------
    name : str
    count : int
    properties : tuple of PlyProperty
        Of each.
    """

    name: str
    count: int
    properties: tuple[PlyProperty, ...] = ()

    def property(self, name: str) -> PlyProperty | None:
        """Return the property `name`, or None."""
        return next((entry for entry in self.properties if entry.name == name), None)


@dataclass(frozen=True)
class PlyHeader:
    """Content of the header, its number of lines, first byte of the data, and its comments.

    Parameters
    ----------
    encoding : {"ascii", "little", "big"}
        Text, or the byte order of binary data.
    elements : tuple of PlyElement
        In the order of the data.
    line_count : int
        Lines of the header.
    data_begin : int
        First byte of the data.
    comments : tuple of str
    """

    encoding: Encoding
    elements: tuple[PlyElement, ...]
    line_count: int
    data_begin: int
    comments: tuple[str, ...] = ()

    def element(self, name: str) -> PlyElement | None:
        """Return the element `name`, or None."""
        return next((entry for entry in self.elements if entry.name == name), None)


def parse_header(content: bytes, path: str | Path) -> PlyHeader:
    """Parse the header in the `content` of a PLY file; `path` is for messages.

    Raises
    ------
    FormatError
        If a line is not one of a PLY header, or ``end_header`` is missing.
    """
    encoding: Encoding | None = None
    elements: list[PlyElement] = []
    comments: list[str] = []
    begin = number = 0
    while begin < len(content):
        end = content.find(b"\n", begin)
        end = len(content) if end < 0 else end
        line, begin, number = content[begin:end].strip(), end + 1, number + 1
        place = f"{path}, line {number}"
        words = line.decode("ascii", errors="replace").split()
        if number == 1:
            if line != b"ply":
                raise FormatError("does not begin with 'ply'", place, "is it a PLY file?")
        elif line == _LAST:
            if encoding is None or not elements:
                raise FormatError("the header names no format or no element", place)
            empty = next((one.name for one in elements if not one.properties), None)
            if empty is not None:
                raise FormatError(f"the element {empty} has no property", place)
            return PlyHeader(encoding, tuple(elements), number, begin, tuple(comments))
        elif words[:1] == ["format"]:
            encoding = _encoding(words, place)
        elif words[:1] == ["element"]:
            elements.append(_element(words, elements, place))
        elif words[:1] == ["property"] and elements:
            elements[-1] = _with_property(elements[-1], words, place)
        elif words[:1] == ["comment"]:
            comments.append(line.decode("utf-8", errors="replace").removeprefix("comment "))
        elif words[:1] != ["obj_info"]:
            raise FormatError(f"{' '.join(words)[:40]!r} is no line of a PLY header", place)
    raise FormatError("the header does not end", f"{path}, line {number}", "the file is truncated")


def _encoding(words: list[str], place: str) -> Encoding:
    if len(words) != 3 or words[1] not in ENCODINGS or words[2] != "1.0":
        raise FormatError(f"{' '.join(words)!r} is no format of PLY 1.0", place)
    return ENCODINGS[words[1]]


def _element(words: list[str], others: list[PlyElement], place: str) -> PlyElement:
    count = whole_number(words[2]) if len(words) == 3 else None
    if count is None:
        raise FormatError("an element needs a name and a count", place)
    if any(other.name == words[1] for other in others):
        raise FormatError(f"the element {words[1]} appears twice", place)
    return PlyElement(words[1], count)


def _with_property(element: PlyElement, words: list[str], place: str) -> PlyElement:
    kinds = words[2:-1] if words[1:2] == ["list"] else words[1:-1]
    wanted = 2 if words[1:2] == ["list"] else 1
    if len(kinds) != wanted or any(kind not in TYPES for kind in kinds):
        raise FormatError(f"{' '.join(words)!r} is no property of PLY", place)
    if element.property(words[-1]):
        raise FormatError(f"the property {words[-1]} of {element.name} appears twice", place)
    count_kind = TYPES[kinds[0]] if wanted == 2 else None
    if count_kind is not None and count_kind.startswith("f"):
        raise FormatError(f"the list {words[-1]} is counted by no whole number", place)
    if len(element.properties) >= _MOST_PROPERTIES:
        raise FormatError(f"{element.name} has over {_MOST_PROPERTIES} properties", place)
    added = PlyProperty(words[-1], TYPES[kinds[-1]], count_kind)
    return PlyElement(element.name, element.count, (*element.properties, added))
