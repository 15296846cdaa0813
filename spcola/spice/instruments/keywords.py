"""Keywords of one instrument in text kernels."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.text import parse_number
from spcola.spice.text_kernel import assignments

Value = tuple[float | str, ...]
_INSTRUMENT = re.compile(r"INS(-?[0-9]{1,10})_(.+)")
_ITEM = re.compile(r"'((?:[^']|'')*)'|([^\s,()']+)")


def instrument_pool(paths: Sequence[str | Path]) -> dict[tuple[int, str], Value]:
    """Return all ``INS<number>_<keyword>`` of text kernels; later files overrule earlier ones.

    Raises
    ------
    FormatError
        If none is found.
    KernelError
        If a file cannot be read.
    """
    pool: dict[tuple[int, str], Value] = {}
    for path in paths:
        for name, operator, text in assignments(Path(path)):
            match = _INSTRUMENT.fullmatch(name.upper())
            if not match:
                continue
            key = (int(match[1]), match[2])
            earlier = pool.get(key, ()) if operator == "+=" else ()
            pool[key] = earlier + _values(text)
    if not pool:
        names = ", ".join(str(path) for path in paths)
        raise FormatError("state no instrument (INS…)", names, "give instrument kernels")
    return pool


def _values(text: str) -> Value:
    """Return the numbers and texts of a right-hand side."""
    return tuple(_item(bare) if bare else quoted for quoted, bare in _ITEM.findall(text))


def _item(text: str) -> float | str:
    try:
        return parse_number(text)
    except ValueError:
        return text


@dataclass(frozen=True)
class Keywords:
    """Keywords of an instrument, those of a variant and a filter first.

    Parameters
    ----------
    pool : mapping
        By instrument number and keyword.
    numbers : tuple of int
        NAIF numbers in the order of search: a filter or focus position of its own, the instrument.
    suffix : str
        Of a filter's keywords, such as ``PAN`` in ``OD_K_PAN``; may be empty.
    where : str
        The files, for messages.
    """

    pool: Mapping[tuple[int, str], Value]
    numbers: tuple[int, ...]
    suffix: str
    where: str

    def get(self, name: str) -> Value | None:
        """Return the first value of a keyword, or None."""
        names = [f"{name}_{self.suffix}", name] if self.suffix else [name]
        for number in self.numbers:
            for one in names:
                if (number, one) in self.pool:
                    return self.pool[number, one]
        return None

    def vector(self, name: str, count: int) -> FloatArray:
        """Return `count` numbers (count,).

        Raises
        ------
        FormatError
            If the keyword is missing, or has others.
        """
        value = self.get(name)
        place = f"{self.where}: INS{self.numbers[-1]}_{name}"
        if value is None:
            raise FormatError("is missing", place)
        numbers = [item for item in value if isinstance(item, float)]
        if len(numbers) != len(value) or len(numbers) != count:
            raise FormatError(f"is {value}, {count} numbers are needed", place)
        return np.array(numbers)

    def number(self, name: str) -> float:
        """Return one number.

        Raises
        ------
        FormatError
            If the keyword is missing or has others.
        """
        return float(self.vector(name, 1)[0])

    def pixels(self, name: str) -> int:
        """Return a number of pixels.

        Raises
        ------
        FormatError
            If the keyword is missing or is no whole number above 0.
        """
        value = self.number(name)
        if value != int(value) or value < 1:
            place = f"{self.where}: INS{self.numbers[-1]}_{name}"
            raise FormatError(f"is {value:g}, no number of pixels", place)
        return int(value)

    def text(self, name: str) -> str:
        """Return a text in capitals, or an empty one if there is none."""
        value = self.get(name)
        return str(value[0]).strip().upper() if value else ""
