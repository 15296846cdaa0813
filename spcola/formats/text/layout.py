"""Preservation of the layout of an existing text file when it is written again."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

from spcola.formats.text.fortran import is_number, parse_number
from spcola.formats.text.source import read_bytes

_ALIASES = {"SIG_VSO": "SIGMA_VSO", "SIG_PTG": "SIGMA_PTG", "SIMGA_LMK": "SIGMA_LMK"}

_Key = tuple[str, str]


def in_layout_of(text: str, like: str | Path | None) -> str:
    """Return `text` with lines from the file `like` wherever these have the same content.

    A line of the old file is kept if each of its numbers rounds to that of the new line: spacing,
    labels, further digits and the end of the file are preserved. Where all lines of the old file
    still occur, headings without entries are kept as well.

    Parameters
    ----------
    text : str
        A .SUM, .LMK or .NOM file as this program writes it.
    like : str or Path or None
        The file whose layout is preserved; None returns `text`.

    Raises
    ------
    FormatError
        If `like` cannot be read.
    """
    if like is None:
        return text
    new = _keyed_lines(text)
    old = _keyed_lines(read_bytes(like).decode("ascii", errors="replace"))
    kept = dict(old)
    wanted = dict(new)
    if [key for key, _ in old if key in wanted or not _is_bare(key)] == list(wanted):
        lines = [
            line if key not in wanted or _has_same_content(wanted[key], line) else wanted[key]
            for key, line in old
        ]
    else:
        lines = [
            kept[key] if key in kept and _has_same_content(line, kept[key]) else line
            for key, line in new
        ]
    # A file may end without a line end, and its last line may have got another after it.
    ended = [line if line.endswith(("\n", "\r")) else f"{line}\n" for line in lines[:-1]]
    return "".join([*ended, *lines[-1:]])


def _keyed_lines(text: str) -> list[tuple[_Key, str]]:
    """Return each line with its key: its number before the sections, its name in them."""
    keyed: list[tuple[_Key, str]] = []
    section = ""
    for number, line in enumerate(text.splitlines(keepends=True)):
        words = line.split()
        if number > 1 and words and all(word.isalpha() and word.isupper() for word in words):
            section = " ".join(words)
            keyed.append((("", section), line))
        else:
            entry = words[0].rstrip("*") if words and section else str(number)
            keyed.append(((section or "line", entry), line))
    return keyed


def _is_bare(key: _Key) -> bool:
    """Whether `key` is that of a heading."""
    return key[0] == ""


def _has_same_content(new: str, old: str) -> bool:
    """Return whether each word of `old` is that of `new`, or a number that rounds to it."""
    old_words = [_ALIASES.get(word, word) for word in _words(old)]
    new_words = _words(new)
    if old_words[-1:] == ["SIGPXL"]:
        return not any(parse_number(word) for word in new_words[:-1])
    if len(old_words) == 2 and len(new_words) == 4:  # one sigma for all three
        old_words = [old_words[0]] * 3 + old_words[1:]
    return len(old_words) == len(new_words) and all(
        a == b or (is_number(a) and is_number(b) and _rounds_to(a, b))
        for a, b in zip(old_words, new_words, strict=True)
    )


def _words(line: str) -> list[str]:
    """Return the words of a line; the ``*`` of a de-weighted observation is one, at the end."""
    words = line.replace("*", " ").split()
    return [*words, "*"] if "*" in line else words


def _rounds_to(old: str, new: str) -> bool:
    """Whether the number `old`, rounded to the digits that `new` shows, is `new`."""
    exponent = Decimal(new.upper().replace("D", "E")).as_tuple().exponent
    unit = 10.0 ** int(exponent)
    # Half a unit, and the rounding error of a double.
    return abs(parse_number(old) - parse_number(new)) <= 0.5 * unit * (1.0 + 1e-6)
