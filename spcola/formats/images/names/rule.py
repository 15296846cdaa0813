"""How SPC names images: camera, time and filter in twelve characters."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from math import floor, isfinite

from spcola.errors import InvalidValueError
from spcola.formats.text.source import check_name

_SECONDS = 10**9


@dataclass(frozen=True)
class NamedImage:
    """What the name of an image is made from.

    Parameters
    ----------
    original : str
        Name of the product or file.
    et : float
        Middle of the exposure, TDB seconds past J2000.
    filter : str, optional
        Name or number of the filter.
    """

    original: str
    et: float
    filter: str | None = None


def is_spc_name(name: str) -> bool:
    """Return whether an image may have this name in SPC.

    Parameters
    ----------
    name : str
        Up to twelve characters, without spaces, slashes, ``*`` and what is outside ASCII.
    """
    try:
        check_name(name, "image", name)
    except InvalidValueError:
        return False
    return True


def spc_name(camera: str, image: NamedImage) -> str:
    """Return the name of an image in SPC (Gaskell et al., section 2.1).

    One character for the camera, nine digits for the integral part of the ephemeris time, two
    characters for the filter. The integral part is that of floor(ET) modulo 10⁹: before J2000 the
    digits are those of 10⁹ + ET, and names are unique for 31 years. The filter is a number of two
    digits, or the first two letters and digits of its name in capitals, filled with ``X``; nothing
    if there is none.

    Parameters
    ----------
    camera : str
        One letter or digit.
    image : NamedImage

    Raises
    ------
    InvalidValueError
        If the camera is not one letter or digit, or the time is not finite.
    """
    if not re.fullmatch(r"[A-Za-z0-9]", camera):
        raise InvalidValueError(f"is {camera!r}", "camera's letter", "give one letter or digit")
    if not isfinite(image.et):
        raise InvalidValueError("has no time to make a name from", image.original)
    name = f"{camera}{floor(image.et) % _SECONDS:09d}{_filter_code(image.filter)}"
    return check_name(name, "image", image.original)


def spc_names(camera: str, images: Iterable[NamedImage]) -> dict[str, str]:
    """Return original name by SPC's name, in the order given.

    Parameters
    ----------
    camera : str
        One letter or digit.
    images : iterable of NamedImage

    Raises
    ------
    InvalidValueError
        If two images get one name: they are of the same second and filter.
    """
    names: dict[str, str] = {}
    for image in images:
        name = spc_name(camera, image)
        if name in names:
            raise InvalidValueError(
                f"{names[name]} and {image.original} both get the name {name}",
                "names of images",
                "give one of them another camera letter or its own name",
            )
        names[name] = image.original
    return names


def _filter_code(name: str | None) -> str:
    """Return two characters, or none."""
    letters = re.sub(r"[^A-Za-z0-9]", "", name or "").upper()
    if not letters:
        return ""
    if letters.isdigit():
        return f"{int(letters) % 100:02d}"
    return letters[:2].ljust(2, "X")
