"""The sections at the end of .SUM and .LMK files: observations and overlaps."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from spcola.camera import ImagePoint
from spcola.control import MapOverlap
from spcola.errors import InvalidValueError
from spcola.formats.text.lines import LineCursor
from spcola.formats.text.source import check_name

END = "END FILE"

Entry = ImagePoint | MapOverlap


def read_sections(
    cursor: LineCursor, parsers: dict[str, Callable[[LineCursor, list[str]], Entry]]
) -> dict[str, tuple[Entry, ...]]:
    """Read the rest of a file: sections in any order, each under its heading, to ``END FILE``.

    Parameters
    ----------
    cursor : LineCursor
        Before the first heading.
    parsers : dict
        For each allowed heading (at most once), the parser of one of its lines.

    Returns
    -------
    dict
        The entries under each heading; a section that is absent has none.

    Raises
    ------
    FormatError
        If a heading is unknown or appears twice, an entry is invalid, the end is missing, or
        something follows it.
    """
    found: dict[str, tuple[Entry, ...]] = {}
    heading = cursor.next(END)
    while heading != END:
        if heading not in parsers:
            raise cursor.error(f"{heading!r} is none of the headings {', '.join(parsers)}, {END}")
        if heading in found:
            raise cursor.error(f"the heading {heading} appears twice")
        entries = []
        first, found[heading] = heading, ()
        while not _is_heading(heading := cursor.next(END)):
            entries.append(parsers[first](cursor, heading.split()))
        found[first] = tuple(entries)
    while cursor.number < len(cursor.lines):
        if cursor.next("nothing"):
            raise cursor.error(f"something follows {END}")
    return {heading: found.get(heading, ()) for heading in parsers}


def points_under(found: dict[str, tuple[Entry, ...]], heading: str) -> tuple[ImagePoint, ...]:
    """Return the observations that :func:`read_sections` found under `heading`."""
    return tuple(entry for entry in found[heading] if isinstance(entry, ImagePoint))


def read_point(cursor: LineCursor, tokens: list[str], kind: str, *, extra: bool) -> ImagePoint:
    """Return the observation on the current line: name, pixel, line and perhaps a ``*``.

    Parameters
    ----------
    cursor : LineCursor
        At that line.
    tokens : list of str
        Its words.
    kind : {"image", "landmark"}
        Type of the name.
    extra : bool
        Whether more numbers may follow (limb lines); they are kept as text.

    Raises
    ------
    FormatError
        If a name is too long, a number is none, or there are too few or too many.
    """
    marked = any(token.endswith("*") for token in tokens)
    words = [token.rstrip("*") for token in tokens if token != "*"]
    if len(words) < 3 or (len(words) > 3 and not extra):
        raise cursor.error(f"expected a name, a pixel and a line, found {len(words)} words")
    name = read_name(cursor, words[0], kind)
    values = cursor.numbers(words[1:], name)
    return ImagePoint(name, float(values[0]), float(values[1]), marked, tuple(words[3:]))


def read_name(cursor: LineCursor, text: str, kind: str) -> str:
    """Return the name on the current line, or raise a FormatError if it does not fit SPC."""
    try:
        return check_name(text, kind, cursor.place)
    except InvalidValueError as error:
        raise cursor.error(error.what, error.do) from error


def refuse_duplicates(cursor: LineCursor, points: Sequence[Entry], heading: str) -> None:
    """Raise a FormatError where a name appears twice in a section, read with `cursor`."""
    seen: set[str] = set()
    for index, point in enumerate(points):
        if point.name in seen:
            cursor.number = cursor.lines.index(heading) + index + 2
            raise cursor.error(f"{point.name} appears twice under {heading}", "remove one line")
        seen.add(point.name)


def point_line(point: ImagePoint, kind: str, width: int) -> str:
    """Return an observation's line: name in `width` columns, pixel and line in ten each."""
    check_name(point.name, kind, point.name)
    if not (abs(point.pixel) < 1e7 and abs(point.line) < 1e7):
        raise InvalidValueError(
            f"pixel {point.pixel}, line {point.line} do not fit their columns", point.name
        )
    extra = "".join(f"{text:>10}" for text in point.extra)
    mark = " *" if point.deweighted else ""
    return f"{point.name:<{width}}{point.pixel:10.2f}{point.line:10.2f}{extra}{mark}\n"


def _is_heading(line: str) -> bool:
    """Whether `line` starts a section (or ends the file)."""
    return line.replace(" ", "").isalpha() and line == line.upper()
