"""Numbers as Fortran writes them: D exponents, a mantissa below one, fixed columns."""

from __future__ import annotations

import re

import numpy as np

from spcola.arrays import FloatArray

LABEL_COLUMN = 63
"""Column of the labels in .SUM, .NOM and .LMK files."""
LARGEST_NUMBER = 1e100
"""Larger than any measurement; its square is still a double."""

# Only one way to match each digit: two would take quadratic time for a long row of them.
_NUMBER = re.compile(r"[+-]?(\d+(?:\.\d*)?|\.\d+)([DdEe][+-]?\d+|[+-]\d{3})?")
_EXPONENT = re.compile(r"(?<=[\d.])[Dd]?(?=[+-]\d)|[Dd]")


def parse_number(text: str) -> float:
    """Return the number in `text`; ``0.5D-02``, ``5E-3``, ``.5-100`` and ``5`` are numbers.

    Raises
    ------
    ValueError
        If it is not a number up to 1e100: ``NaN``, ``Infinity`` and the ``****`` of a number that
        overflowed its column are refused with the rest.
    """
    if not _NUMBER.fullmatch(text):
        reason = "a number that overflowed its column" if set(text) == {"*"} else "not a number"
        raise ValueError(f"{text!r} is {reason}")
    value = float(_EXPONENT.sub("E", text, count=1))
    if not abs(value) <= LARGEST_NUMBER:
        raise ValueError(f"{text!r} is too large")
    return value


def is_number(text: str) -> bool:
    """Whether :func:`parse_number` reads `text`."""
    return _NUMBER.fullmatch(text) is not None


def format_d(value: float, width: int, digits: int) -> str:
    """Format as Fortran's ``Dw.d``: ``0.5000000000D-02`` for 0.005 with ten digits.

    An unknown value (NaN) has no Fortran form; it becomes −1, which the readers of this program
    interpret as unknown where only positive numbers make sense (sigmas), and which SPC, squaring
    it, interprets as a weak prior.
    """
    known = -1.0 if np.isnan(value) else value
    mantissa, exponent = f"{abs(known):.{digits - 1}e}".split("e")
    power = int(exponent) + (known != 0)
    sign = "-" if known < 0 else ""
    return f"{sign}0.{mantissa.replace('.', '')}D{power:+03d}".rjust(width)


def format_fixed(value: float, width: int, decimals: int) -> str:
    """Format as Fortran's ``Fw.d``, with more decimals (and columns) where it would lose digits.

    A focal-plane coefficient of 117.647058823 written with four decimals would move a landmark:
    ten significant digits are kept, as in the ``D20.10`` of the other lines. A value that fits
    is written in exactly the columns that SPC gives it.
    """
    rounded = float(f"{value:.9e}")
    text = f"{rounded:.{decimals}f}"
    while float(text) != rounded and decimals < 20:
        decimals += 1
        text = f"{rounded:.{decimals}f}"
    return text.rjust(width) if len(text) < width else f" {text}"


def labelled(text: str, label: str) -> str:
    """Return a line with its `label` in column 63, as in SPC, or after longer text."""
    return f"{text:<{LABEL_COLUMN - 1}} {label}\n"


def vector_line(vector: FloatArray, label: str) -> str:
    """Return a line of three numbers as ``3D20.10`` and its `label`."""
    return labelled("".join(format_d(float(value), 20, 10) for value in vector), label)
