"""Reading of a file's bytes, and limits of plausible numbers."""

from __future__ import annotations

import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError, InvalidValueError

KM = 1000.0
"""Metres in a kilometre, the unit of SPC files."""

LARGEST_RADIUS_KM = 1e5
"""No surface point of a solid body lies further from its centre (Jupiter's radius is 7e4 km)."""
LARGEST_GSD_KM = 100.0
LARGEST_RANGE_KM = 1e7

_MOST_DIGITS = 18
_LONGEST_NAME = {"image": 12, "landmark": 6}


def regular_size(path: str | Path) -> int:
    """Return the size in bytes of a regular file.

    A pipe or a device has no size that limits the work on it, and may never end.

    Raises
    ------
    FormatError
        If it is not a regular file.
    OSError
        If it does not exist, or this user has no access.
    """
    status = Path(path).stat()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
        raise FormatError(
            "is a pipe or a device, not a regular file", path, "write its content to a file first"
        )
    return status.st_size


def read_text_bytes(path: str | Path) -> bytes:
    """Return the content of a text file without the byte 0x1A at the end of DOS files."""
    return read_bytes(path).rstrip(b"\x1a")


def whole_number(text: str) -> int | None:
    """Return the value of ASCII digits; None if there are others, or too many for any file."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= _MOST_DIGITS else None


def read_bytes(path: str | Path, *, most: int = -1) -> bytes:
    """Return the content of `path`, or its first `most` bytes.

    A FormatError if it cannot be read, is no regular file, or is empty.
    """
    try:
        regular_size(path)
        with Path(path).open("rb") as stream:
            content = stream.read(most)
    except OSError as error:
        raise FormatError(
            f"cannot be read ({error.strerror or error})", path, "check its name and permissions"
        ) from error
    if not content:
        raise FormatError("is empty", path, "copy or make it again")
    return content


@contextmanager
def as_format_error(place: str = "") -> Iterator[None]:
    """Turn an `InvalidValueError` raised inside into a `FormatError` at `place` of a file.

    Without a place the error names it.
    """
    try:
        yield
    except InvalidValueError as error:
        if not place:
            raise FormatError(error.what, error.where, error.do) from error
        field = "" if error.where is None else f"{error.where} "
        raise FormatError(f"{field}{error.what}", place, error.do) from error


def check_name(name: str, kind: str, where: str | Path) -> str:
    """Return `name` if it fits SPC: an image's 12 characters, a landmark's 6.

    Parameters
    ----------
    name : str
    kind : {"image", "landmark"}
    where : str or Path
        For the message.

    Raises
    ------
    InvalidValueError
        If it is empty, too long, or has characters that are not allowed in a file name.
    """
    longest = _LONGEST_NAME[kind]
    if not 1 <= len(name) <= longest:
        raise InvalidValueError(
            f"{kind} name {name!r} has {len(name)} characters, 1 to {longest} are allowed",
            where,
            "shorten it",
        )
    if not (name.isascii() and name.isprintable()) or set(name) & set(" /\\*"):
        raise InvalidValueError(
            f"{kind} name {name!r} has a space, a slash, a * or a character outside ASCII",
            where,
            "use letters, digits, '_' and '-'",
        )
    return name


def check_grid_km(center_km: FloatArray, gsd_km: float, half_size: int) -> None:
    """Raise an InvalidValueError unless a maplet frame is plausible in kilometres.

    The rule: GSD between 1e-9 km and 100 km; ``|V|`` at most 1e5 km; and half a side of the maplet
    at most ten times ``|V|`` (a GSD in metres with a V in kilometres breaks this), unless V is 0.
    """
    if not 1e-9 <= gsd_km <= LARGEST_GSD_KM:
        raise InvalidValueError(
            f"of {gsd_km:.6g} km is not between 1e-9 and {LARGEST_GSD_KM:g} km",
            "GSD",
            "is it in another unit or byte order?",
        )
    distance = float(np.linalg.norm(center_km))
    if not distance <= LARGEST_RADIUS_KM:
        raise InvalidValueError(
            f"lies {distance:.6g} km from the body's centre, more than {LARGEST_RADIUS_KM:g} km",
            "V",
            "is it in another unit or byte order?",
        )
    if distance > 0 and half_size * gsd_km > 10.0 * distance:
        raise InvalidValueError(
            f"of {gsd_km:.6g} km makes a maplet of half-side {half_size * gsd_km:.6g} km at "
            f"{distance:.6g} km from the body's centre",
            "GSD",
            "is it in metres?",
        )
