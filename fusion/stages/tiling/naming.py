"""Names of new maplets: two letters and four digits of base 36."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from itertools import product
from string import ascii_uppercase, digits

from spcola.errors import SettingsError

_DIGITS = digits + ascii_uppercase
MOST_NAMES = len(_DIGITS) ** 4 - 1
"""Number of names with the same letters."""


def check_letters(letters: str) -> None:
    """Refuse what is neither empty nor two letters.

    Raises
    ------
    SettingsError
    """
    if letters and not (len(letters) == 2 and letters.isascii() and letters.isalpha()):
        raise SettingsError(f"are two letters, not {letters!r}", "--letters", "such as TB")


def free_letters(taken: Collection[str]) -> str:
    """Return the first two letters, of AA, AB, …, with which no name begins.

    Raises
    ------
    SettingsError
        If there are none left.
    """
    begun = {name[:2].upper() for name in taken}
    for pair in product(ascii_uppercase, repeat=2):
        if (letters := "".join(pair)) not in begun:
            return letters
    raise SettingsError("names of maplets begin with every two letters", do="give --letters")


def free_names(letters: str, taken: Collection[str]) -> Iterator[str]:
    """Yield the names of two letters and 0001, 0002, … 000A, … ZZZZ that are not taken.

    Raises
    ------
    SettingsError
        When there are no more.
    """
    used = {name.upper() for name in taken}
    numbers = product(_DIGITS, repeat=4)
    next(numbers)
    for number in numbers:
        if (name := letters.upper() + "".join(number)) not in used:
            yield name
    raise SettingsError(
        f"there are no more names that begin with {letters.upper()}", "--letters", "give others"
    )
