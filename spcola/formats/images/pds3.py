"""PDS3 images: attached or detached label, as GDAL parses it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spcola.camera.detector import Direction, Orientation
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.images.image_label import (
    ImageLabel,
    elapsed,
    first_text,
    fits_times,
    quantity,
    seconds,
    temperatures,
    text_of,
)
from spcola.formats.images.isis_label import LONGEST_LABEL, group, read_gdal_label
from spcola.formats.images.pixel_sources import PlainArray, chosen_band
from spcola.formats.images.special_values import SpecialValues
from spcola.formats.text import read_bytes

# SAMPLE_TYPE of the PDS3 standard, appendix C: the first part states the byte order.
_BIG = {"MSB", "IEEE", "SUN", "MAC", ""}
_LITTLE = {"LSB", "PC", "VAX"}
_SAMPLE_TYPE = re.compile(
    r"(?:(MSB|LSB|IEEE|SUN|MAC|PC|VAX)_)?(UNSIGNED_INTEGER|INTEGER|REAL|FLOAT)"
)
_LETTERS = {"UNSIGNED_INTEGER": "u", "INTEGER": "i", "REAL": "f", "FLOAT": "f"}
# File systems have no longer names, bytes.
_LONGEST_NAME = 255
_BYTES_UNIT = re.compile(r"\s*(\d+)\s*<\s*BYTES\s*>\s*", re.IGNORECASE)

_MISSING = ("MISSING_CONSTANT", "MISSING", "INVALID_CONSTANT", "INVALID", "NULL", "CORE_NULL")
_DARK = (
    "CORE_LOW_REPR_SATURATION", "CORE_LOW_INSTR_SATURATION",
    "LOW_REPR_SATURATION", "LOW_INSTR_SATURATION",
)  # fmt: skip
_SATURATED = (
    "CORE_HIGH_INSTR_SATURATION", "CORE_HIGH_REPR_SATURATION",
    "HIGH_INSTR_SATURATION", "HIGH_REPR_SATURATION",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class DescribedArray:
    """An image array as a PDS label describes it.

    Parameters
    ----------
    array : PlainArray
    scale, base : float
        ``brightness = base + scale × stored``.
    special : SpecialValues
    label : ImageLabel
    """

    array: PlainArray
    scale: float
    base: float
    special: SpecialValues
    label: ImageLabel


def read_pds3(path: Path, band: int | None = None) -> DescribedArray:
    """Return the image of a PDS3 label.

    Parameters
    ----------
    path : Path
        The image with its label, or the detached label.
    band : int, optional
        Of an image with several ones stored one after the other, from 1.

    Raises
    ------
    FormatError
        If the label cannot be read, has no uncompressed image, or its file is absent or too short.
    InvalidValueError
        If it has no such band.
    """
    # GDAL reads labels of images alone, and does not say that of other ones.
    if b"^IMAGE" not in read_bytes(path, most=LONGEST_LABEL):
        raise FormatError(
            "is a PDS3 label without an image", path, "name the data file that it describes"
        )
    keywords = read_gdal_label(path, "PDS")
    # Labels of several files have the object and its pointer in one that describes the file.
    part = next((p for p in (keywords, *keywords.values()) if _has_image(p)), None)
    if part is None:
        raise FormatError("has no IMAGE object with its ^IMAGE pointer", path)
    entry, pointer = group(part, "IMAGE"), part["^IMAGE"]
    encoding = text_of(entry.get("ENCODING_TYPE"))
    if encoding:
        raise FormatError(
            f"is compressed (ENCODING_TYPE = {encoding})",
            path,
            "decompress it with PDS tools first",
        )
    bands = _whole(entry, "BANDS", path, 1)
    storage = text_of(entry.get("BAND_STORAGE_TYPE"))
    if bands > 1 and storage != "BAND_SEQUENTIAL":
        raise FormatError(f"has {bands} bands stored as {storage}, one is needed", path)
    number = chosen_band(path, band, bands) - 1
    target, offset = _place(path, pointer, {**keywords, **part})
    array = PlainArray(
        target,
        offset,
        _sample_type(entry, path),
        _whole(entry, "LINES", path),
        _whole(entry, "LINE_SAMPLES", path),
        _whole(entry, "LINE_PREFIX_BYTES", path, 0),
        _whole(entry, "LINE_SUFFIX_BYTES", path, 0),
    ).following(number)
    scale, base = (_number(entry, *key) for key in (("SCALING_FACTOR", 1.0), ("OFFSET", 0.0)))
    return DescribedArray(array, scale, base, _special(entry), pds3_label(keywords, path.name))


def pds3_label(keywords: Mapping[str, Any], file_name: str) -> ImageLabel:
    """Return what PDS3 keywords state; the dictionary's unit of an exposure is the millisecond."""
    orientation, notes = display_directions(
        first_text(keywords, "LINE_DISPLAY_DIRECTION")
        or first_text(group(keywords, "IMAGE"), "LINE_DISPLAY_DIRECTION"),
        first_text(keywords, "SAMPLE_DISPLAY_DIRECTION")
        or first_text(group(keywords, "IMAGE"), "SAMPLE_DISPLAY_DIRECTION"),
    )
    start, stop = first_text(keywords, "START_TIME"), first_text(keywords, "STOP_TIME")
    exposure, doubt = _exposure(keywords.get("EXPOSURE_DURATION"), start, stop)
    return ImageLabel(
        name=first_text(keywords, "PRODUCT_ID", "IMAGE_ID", "FILE_NAME") or file_name,
        target=first_text(keywords, "TARGET_NAME"),
        instrument=first_text(keywords, "INSTRUMENT_ID", "INSTRUMENT_NAME"),
        filter=first_text(keywords, "FILTER_NAME", "FILTER_NUMBER", "FILTER_ID"),
        start_utc=start,
        stop_utc=stop,
        mid_utc=first_text(keywords, "IMAGE_MID_TIME", "MID_OBSERVATION_TIME"),
        exposure_s=exposure,
        line_exposure_s=seconds(keywords.get("LINE_EXPOSURE_DURATION"), without_unit=1e-3),
        clock_start=first_text(keywords, "SPACECRAFT_CLOCK_START_COUNT"),
        clock_stop=first_text(keywords, "SPACECRAFT_CLOCK_STOP_COUNT"),
        temperatures_k=temperatures(keywords),
        orientation=orientation,
        keywords=keywords,
        notes=notes + doubt,
    )


def _exposure(
    raw: Any, start: str | None, stop: str | None
) -> tuple[float | None, tuple[str, ...]]:
    """Return the exposure time, seconds, and a note if its unit is not stated.

    Labels have milliseconds, as the dictionary wants, or seconds: what fits start and stop. Without
    these it is milliseconds.
    """
    found = quantity(raw)
    if found is None or found[1] is not None:
        return seconds(raw, without_unit=None), ()
    apart = elapsed(start, stop)
    values = {name: found[0] * unit for name, unit in (("milliseconds", 1e-3), ("seconds", 1.0))}
    name = "milliseconds"
    if apart is not None:
        name = min(values, key=lambda name: abs(values[name] - apart))
    if values[name] > 0 and (apart is None or fits_times(values[name], apart)):
        return values[name], (f"EXPOSURE_DURATION has no unit: read as {name}",)
    return None, ("EXPOSURE_DURATION has no unit, and does not fit start and stop: not used",)


def display_directions(
    line: str | None, sample: str | None
) -> tuple[Orientation | None, tuple[str, ...]]:
    """Return the orientation of two stated directions, and notes; a missing one has its default.

    The defaults are those of PDS: lines down, samples to the right.
    """
    if line is None and sample is None:
        return None, ()
    try:
        down, right = (Direction(text.lower()) for text in (line or "down", sample or "right"))
        return Orientation(down, right), ()
    except (ValueError, InvalidValueError) as error:
        return None, (f"display directions are not used ({error})",)


def _has_image(part: Any) -> bool:
    """Return whether a part of a label has an image and its place."""
    return isinstance(part, Mapping) and {"IMAGE", "^IMAGE"} <= set(part)


def _place(path: Path, pointer: Any, keywords: Mapping[str, Any]) -> tuple[Path, int]:
    """Return the file of the pixels and the bytes before them."""
    parts = pointer if isinstance(pointer, list) else [pointer]
    named = bool(parts) and isinstance(parts[0], str) and not _BYTES_UNIT.fullmatch(parts[0])
    target = file_next_to(path, parts[0]) if named else path
    rest = parts[1:] if named else parts
    if not rest:
        return target, 0
    place = rest[0]
    if isinstance(place, str) and (matched := _BYTES_UNIT.fullmatch(place)):
        place = {"value": int(matched.group(1)), "unit": "BYTES"}
    found = quantity(place)
    if found is None or found[0] < 1 or found[0] != int(found[0]):
        raise FormatError(f"has an unusable ^IMAGE pointer ({pointer})", path)
    if found[1] == "bytes":
        return target, int(found[0]) - 1
    return target, (int(found[0]) - 1) * _whole(keywords, "RECORD_BYTES", path)


def file_next_to(label: Path, name: str) -> Path:
    """Return the file `name` in the label's folder, whatever the case of its letters.

    Raises
    ------
    FormatError
        If it is absent, or `name` is no plain file name.
    """
    plain = Path(name).name == name and "\\" not in name
    if not plain or not 0 < len(name.encode()) <= _LONGEST_NAME:
        raise FormatError(f"names {name!r}, which is no file of its folder", label)
    for spelling in (name, name.lower(), name.upper()):
        if (label.parent / spelling).is_file():
            return label.parent / spelling
    for other in label.parent.iterdir():
        if other.name.lower() == name.lower() and other.is_file():
            return other
    raise FormatError(
        f"names {name}, which is not in the same folder", label, "copy both into one folder"
    )


def _sample_type(entry: Mapping[str, Any], path: Path) -> np.dtype[np.generic]:
    """Return the type of a pixel."""
    text = str(text_of(entry.get("SAMPLE_TYPE"))).upper()
    bits = _whole(entry, "SAMPLE_BITS", path)
    matched = _SAMPLE_TYPE.fullmatch(text)
    order, letter = (matched[1] or "", _LETTERS[matched[2]]) if matched else ("", "")
    sizes = (32, 64) if letter == "f" else (8, 16, 32)
    if not matched or bits not in sizes or (order == "VAX" and letter == "f"):
        raise FormatError(f"has pixels of {bits} bits as {text}, which are not read", path)
    assert (order in _BIG) != (order in _LITTLE)
    return np.dtype(f"{'>' if order in _BIG else '<'}{letter}{bits // 8}")


def _special(entry: Mapping[str, Any]) -> SpecialValues:
    """Return the special values; ``16#FF7FFFFB#`` is the pattern of a floating-point number."""
    real = "REAL" in str(entry.get("SAMPLE_TYPE")).upper()
    missing, dark, saturated = (
        tuple(found for name in names if (found := _constant(entry.get(name), real)) is not None)
        for names in (_MISSING, _DARK, _SATURATED)
    )
    level = quantity(entry.get("PIXEL_SATURATION_VALUE"))
    return SpecialValues(missing, dark, saturated, highest=level[0] if level else None)


def _constant(value: Any, real: bool) -> float | None:
    """Return a constant, also one in another base."""
    if isinstance(value, str) and (matched := re.fullmatch(r"(\d+)#([0-9A-Fa-f]+)#", value)):
        number = int(matched[2], int(matched[1])) if matched[1] in ("2", "8", "16") else None
        if number is None or number >= 1 << 32:
            return None
        return float(np.uint32(number).view(np.float32)) if real else float(number)
    found = quantity(value)
    return None if found is None else found[0]


def _whole(entry: Mapping[str, Any], key: str, path: Path, default: int | None = None) -> int:
    """Return a whole number of the label that is not negative."""
    found = quantity(entry.get(key))
    if found is None and default is not None and text_of(entry.get(key)) is None:
        return default
    least = 1 if default is None else 0
    if found is None or found[0] != int(found[0]) or not least <= found[0] < 1 << 40:
        raise FormatError(f"has no usable {key} ({text_of(entry.get(key))})", path)
    return int(found[0])


def _number(entry: Mapping[str, Any], key: str, default: float) -> float:
    found = quantity(entry.get(key))
    return default if found is None else found[0]
