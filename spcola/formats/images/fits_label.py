"""FITS images: size, type and keywords, read from the headers alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from spcola.errors import FormatError, SpcolaError
from spcola.formats.images.image_label import (
    ImageLabel,
    first_text,
    kelvin,
    quantity,
    seconds,
    text_of,
)
from spcola.formats.images.pixel_sources import chosen_band
from spcola.formats.images.special_values import SpecialValues, check_scaling
from spcola.formats.images.warning_filters import warnings_as
from spcola.formats.text import regular_size

_TYPES = {8: "u1", 16: "i2", 32: "i4", 64: "i8", -32: "f4", -64: "f8"}
_BLOCK = 2880
_MOST_UNITS = 100


@dataclass(frozen=True, eq=False)
class FitsImage:
    """The first image of a FITS file.

    Parameters
    ----------
    unit : int
        Its number, 0 for the primary array.
    width, height : int
    stored : numpy.dtype
        Type in the file.
    offset : int
        Bytes before its first pixel.
    plane : tuple of int
        Place of the image along the axes beyond two, slowest first, from 0.
    unsigned : bool
        Whether BZERO only makes integers without sign.
    scaling : (2,) of float
        BSCALE and BZERO.
    special : SpecialValues
        Of the numbers that :class:`FitsUnit` returns.
    label : ImageLabel
    """

    unit: int
    width: int
    height: int
    stored: np.dtype[np.generic]
    offset: int
    plane: tuple[int, ...]
    unsigned: bool
    scaling: tuple[float, float]
    special: SpecialValues
    label: ImageLabel


def read_fits_headers(path: Path, band: int | None = None) -> FitsImage:
    """Return the first image of a FITS file without reading its pixels.

    Parameters
    ----------
    path : Path
    band : int, optional
        Plane of a cube, from 1.

    Raises
    ------
    FormatError
        If a header cannot be read, there is no image, it has several planes of which none is
        asked for, or the file is shorter than the headers state.
    InvalidValueError
        If it has no such plane.
    """
    from astropy.io import fits  # noqa: PLC0415  (a quarter of a second at start-up)

    length = regular_size(path)
    primary: dict[str, Any] = {}
    try:
        with path.open("rb") as stream, warnings_as("error"):
            for unit in range(_MOST_UNITS):
                header = fits.Header.fromfile(stream)
                offset = stream.tell()
                found = _size(header, path, unit, length - offset)
                if header.get("XTENSION", "IMAGE").strip() == "IMAGE" and header["NAXIS"] >= 2:
                    keywords = {**primary, **_keywords(header)}
                    return _image(path, (unit, band), header, keywords, offset)
                primary = primary or _keywords(header)
                stream.seek(offset + -(-found // _BLOCK) * _BLOCK)
    except EOFError:
        pass
    except SpcolaError:
        raise
    except Exception as error:
        raise FormatError(f"cannot be read as FITS ({error})", path) from error
    raise FormatError("has no image in it", path, "tables and compressed images are not read")


def _size(header: Any, path: Path, unit: int, left: int) -> int:
    """Return the bytes of a unit's data."""
    axes = header.get("NAXIS")
    if isinstance(axes, bool) or not isinstance(axes, int) or not 0 <= axes <= 9:
        raise FormatError(f"cannot be read as FITS (NAXIS is {axes!r})", path)
    lengths = [header.get(f"NAXIS{number + 1}") for number in range(axes)]
    numbers = [header.get("BITPIX"), header.get("PCOUNT", 0), header.get("GCOUNT", 1), *lengths]
    if not all(isinstance(n, int) and not isinstance(n, bool) for n in numbers):
        raise FormatError(f"has no size of unit {unit} in its header", path)
    bitpix, pcount, gcount = numbers[:3]
    if bitpix not in _TYPES or min([pcount, gcount, *lengths], default=0) < 0:
        raise FormatError(f"has an impossible size of unit {unit} (BITPIX {bitpix})", path)
    count = int(np.prod([float(n) for n in lengths])) if lengths else 0
    size = abs(bitpix) // 8 * gcount * (pcount + count)
    if size > left:
        raise FormatError(
            f"has {left} bytes for unit {unit}, its header needs {size}",
            path,
            "the file is truncated; copy it again",
        )
    return int(size)


def _image(
    path: Path, place: tuple[int, int | None], header: Any, keywords: dict[str, Any], offset: int
) -> FitsImage:
    """Return the image of a header; `place` is its unit, and the plane that is asked for."""
    unit, band = place
    beyond = [header[f"NAXIS{number}"] for number in range(header["NAXIS"], 2, -1)]
    number = chosen_band(path, band, prod(beyond)) - 1
    plane = tuple(int(part) for part in np.unravel_index(number, beyond)) if beyond else ()
    width, height = header["NAXIS1"], header["NAXIS2"]
    if not (width > 0 and height > 0):
        raise FormatError(f"has an image of {width} × {height} pixels", path)
    stored = np.dtype(">" + _TYPES[header["BITPIX"]])
    scaling = float(header.get("BSCALE", 1)), float(header.get("BZERO", 0))
    check_scaling(*scaling, path)
    half = 2.0 ** (8 * stored.itemsize - 1)
    unsigned = stored.kind == "i" and scaling == (1.0, half)
    shift = half if unsigned else 0.0
    blank, saturated = _number(header, "BLANK"), _number(header, "SATURATE")
    special = SpecialValues(
        () if blank is None or stored.kind == "f" else (blank + shift,),
        highest=None if saturated is None else (saturated - scaling[1]) / scaling[0] + shift,
    )
    label = fits_label(keywords, path.name)
    offset += number * width * height * stored.itemsize
    return FitsImage(unit, width, height, stored, offset, plane, unsigned, scaling, special, label)


def _number(header: Any, key: str) -> float | None:
    value = header.get(key)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _keywords(header: Any) -> dict[str, Any]:
    """Return the keywords; a unit in the comment's first brackets goes with its number."""
    found: dict[str, Any] = {}
    for card in header.cards:
        if not card.keyword or card.keyword in ("COMMENT", "HISTORY", "END"):
            continue
        comment = card.comment or ""
        unit = comment[1 : comment.find("]")] if comment.startswith("[") else None
        number = isinstance(card.value, int | float) and not isinstance(card.value, bool)
        found[card.keyword] = {"value": card.value, "unit": unit} if unit and number else card.value
    return found


def fits_label(keywords: Mapping[str, Any], file_name: str) -> ImageLabel:
    """Return what FITS keywords state.

    Of the standard: DATE-BEG, DATE-END, DATE-AVG (UTC of start, end and middle), DATE-OBS (start),
    XPOSURE, EXPTIME (seconds), OBJECT, INSTRUME, FILTER. Of missions: MIDOBS and New Horizons'
    SPCUTCID (middle). This program's own: IMGNAME, and UTC (middle). EXPOSURE is used with a unit
    only: some missions have seconds, others (LORRI) milliseconds.
    """
    own = "IMGNAME" in keywords
    notes: tuple[str, ...] = ()
    exposures = [seconds(keywords.get(key), without_unit=1.0) for key in ("XPOSURE", "EXPTIME")]
    exposures.append(seconds(keywords.get("EXPOSURE"), without_unit=None))
    exposure = next((value for value in exposures if value is not None), None)
    if exposure is None and quantity(keywords.get("EXPOSURE")) is not None:
        notes = ("EXPOSURE has no unit and is not used",)
    temperatures = {
        key: value
        for key, raw in keywords.items()
        if "TEMP" in key and (value := kelvin(raw)) is not None
    }
    return ImageLabel(
        name=first_text(keywords, "IMGNAME", "PRODNAME", "FILENAME") or file_name,
        target=first_text(keywords, "TARGET", "OBJECT"),
        instrument=first_text(keywords, "INSTRUME"),
        filter=first_text(keywords, "FILTER", "FILTNAME"),
        start_utc=_utc(keywords, "DATE-BEG", "DATE-OBS"),
        stop_utc=_utc(keywords, "DATE-END"),
        mid_utc=_utc(keywords, "DATE-AVG", "MIDOBS", "SPCUTCID", *(["UTC"] if own else [])),
        exposure_s=exposure,
        clock_start=first_text(keywords, "SCLK", "MET"),
        temperatures_k=temperatures,
        keywords=keywords,
        notes=notes,
    )


def _utc(keywords: Mapping[str, Any], *names: str) -> str | None:
    """Return the first time; a date alone is none."""
    return next(
        (text for text in (text_of(keywords.get(name)) for name in names) if text and ":" in text),
        None,
    )
