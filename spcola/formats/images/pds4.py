"""PDS4 images: the label is XML, the pixels a plain array in another file."""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from spcola.camera.detector import Orientation
from spcola.errors import FormatError
from spcola.formats.images.image_label import ImageLabel, kelvin, quantity, seconds, text_of
from spcola.formats.images.pds3 import DescribedArray, display_directions, file_next_to
from spcola.formats.images.pixel_sources import PlainArray, chosen_band
from spcola.formats.images.special_values import SpecialValues
from spcola.formats.text import read_bytes, regular_size

_TYPES = {
    "UnsignedByte": "u1", "SignedByte": "i1",
    "UnsignedMSB2": ">u2", "UnsignedLSB2": "<u2", "SignedMSB2": ">i2", "SignedLSB2": "<i2",
    "UnsignedMSB4": ">u4", "UnsignedLSB4": "<u4", "SignedMSB4": ">i4", "SignedLSB4": "<i4",
    "IEEE754MSBSingle": ">f4", "IEEE754LSBSingle": "<f4",
    "IEEE754MSBDouble": ">f8", "IEEE754LSBDouble": "<f8",
}  # fmt: skip
_IMAGES = ("Array_2D_Image", "Array_3D_Image")
_DIRECTIONS = {
    "left to right": "right", "right to left": "left",
    "top to bottom": "down", "bottom to top": "up",
}  # fmt: skip
_MISSING = ("missing_constant", "invalid_constant", "unknown_constant", "error_constant")
_DARK = ("low_instrument_saturation", "low_representation_saturation")
_SATURATED = (
    "saturated_constant", "high_instrument_saturation", "high_representation_saturation",
)  # fmt: skip
_MOST_BYTES = 1 << 24
_DEEPEST = 60


def read_pds4(path: Path, band: int | None = None) -> DescribedArray:
    """Return the first Array_2D_Image or Array_3D_Image of a PDS4 label.

    Parameters
    ----------
    path : Path
        The label (XML).
    band : int, optional
        Of an Array_3D_Image, from 1.

    Raises
    ------
    FormatError
        If it is no PDS4 label, has no image, or its file is absent or has another size.
    InvalidValueError
        If it has no such band.
    """
    keywords = _tree(path)
    areas = _all(keywords, "File_Area_Observational")
    images = ((area, image) for area in areas for name in _IMAGES for image in _all(area, name))
    area, entry = next(images, (None, None))
    if area is None:
        raise FormatError(
            "is a PDS4 label without an image", path, "name the data file that it describes"
        )
    target = file_next_to(path, text_of(_at(area, "File", "file_name")) or "")
    size = quantity(_at(area, "File", "file_size"))
    if size is not None and size[1] in (None, "byte") and size[0] != regular_size(target):
        raise FormatError(
            f"has {regular_size(target)} bytes, its label {path.name} gives {size[0]:.0f}",
            target,
            "the file is truncated, or the label is another image's",
        )
    array = _array(entry, target, path, band)
    element = _at(entry, "Element_Array")
    scale, base = (
        found[0] if (found := quantity(_at(element, key))) else default
        for key, default in (("scaling_factor", 1.0), ("value_offset", 0.0))
    )
    constants = _at(entry, "Special_Constants")
    missing, dark, saturated = (
        tuple(found[0] for key in names if (found := quantity(_at(constants, key))))
        for names in (_MISSING, _DARK, _SATURATED)
    )
    special = SpecialValues(missing, dark, saturated)
    return DescribedArray(array, scale, base, special, pds4_label(keywords, path.name))


def pds4_label(keywords: Mapping[str, Any], file_name: str) -> ImageLabel:
    """Return what a PDS4 label states."""
    observation = _at(keywords, "Observation_Area") or {}
    times = _at(observation, "Time_Coordinates")
    discipline = _at(observation, "Discipline_Area") or {}
    orientation, notes = _orientation(discipline)
    identifier = text_of(_at(keywords, "Identification_Area", "logical_identifier"))
    instrument = next(
        (
            text_of(_at(part, "name"))
            for part in _all(_at(observation, "Observing_System"), "Observing_System_Component")
            if text_of(_at(part, "type")) == "Instrument"
        ),
        None,
    )
    devices = {
        f"{text_of(_at(item, 'device_name'))}": value
        for item in _anywhere(discipline, "Device_Temperature")
        if (value := kelvin(_at(item, "temperature_value"))) is not None
    }
    return ImageLabel(
        name=identifier.split(":")[-1] if identifier else file_name,
        target=text_of(_at(observation, "Target_Identification", "name")),
        instrument=instrument,
        filter=_first(discipline, "filter_name", "filter_id", "filter_number"),
        start_utc=text_of(_at(times, "start_date_time")),
        stop_utc=text_of(_at(times, "stop_date_time")),
        exposure_s=next(
            (
                value
                for item in _anywhere(discipline, "exposure_duration")
                if (value := seconds(item, without_unit=None)) is not None
            ),
            None,
        ),
        clock_start=_first(discipline, "spacecraft_clock_start"),
        clock_stop=_first(discipline, "spacecraft_clock_stop"),
        temperatures_k=devices,
        orientation=orientation,
        keywords=keywords,
        notes=notes,
    )


def _orientation(discipline: Mapping[str, Any]) -> tuple[Orientation | None, tuple[str, ...]]:
    """Return the display directions of display and geometry; none if they differ."""
    found: list[tuple[str, str]] = []
    for item in _anywhere(discipline, "Display_Direction"):
        shown = {
            str(text_of(_at(item, f"{axis}_display_axis"))).lower(): _DIRECTIONS.get(
                str(text_of(_at(item, f"{axis}_display_direction"))).lower(), "?"
            )
            for axis in ("horizontal", "vertical")
        }
        if {"line", "sample"} <= set(shown):
            found.append((shown["line"], shown["sample"]))
    if not found:
        return None, ()
    different = dict.fromkeys(found)
    if len(different) > 1:
        stated = " and ".join(f"line {line}, sample {sample}" for line, sample in different)
        return None, (f"the label's display directions contradict each other ({stated})",)
    return display_directions(*found[0])


def _array(entry: Any, target: Path, path: Path, band: int | None) -> PlainArray:
    """Return place, type and size of an image."""
    kind = text_of(_at(entry, "Element_Array", "data_type"))
    if kind not in _TYPES:
        raise FormatError(f"has pixels of type {kind}, which are not read", path)
    order = text_of(_at(entry, "axis_index_order"))
    axes = sorted(_all(entry, "Axis_Array"), key=lambda axis: str(_at(axis, "sequence_number")))
    names = [str(text_of(_at(axis, "axis_name"))).lower() for axis in axes]
    if order != "Last Index Fastest" or names[-2:] != ["line", "sample"]:
        raise FormatError(
            f"has an array with axes {names} and order {order!r}; line, sample and last index "
            "fastest are needed",
            path,
        )
    counts = [quantity(_at(axis, "elements")) for axis in axes]
    offset = quantity(_at(entry, "offset"))
    numbers = [n[0] if n else -1.0 for n in (*counts, offset)]
    if not (min(numbers[:-1]) >= 1 and numbers[-1] >= 0 and max(numbers) < 1 << 40):
        raise FormatError("has no usable size or offset of its image", path)
    *planes, lines, samples, start = (int(n) for n in numbers)
    number = chosen_band(path, band, prod(planes)) - 1
    return PlainArray(target, start, np.dtype(_TYPES[kind]), lines, samples).following(number)


def _tree(path: Path) -> dict[str, Any]:
    """Return the elements of a label as nested dictionaries, names without namespace."""
    content = read_bytes(path, most=_MOST_BYTES)
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # Lookup: its encoding
        raise FormatError(f"cannot be read as XML ({error})", path) from error
    if "pds.nasa.gov/pds4" not in root.tag:
        raise FormatError(f"is XML ({_local(root.tag)}), but no PDS4 label", path)
    tree = _value(root, path, 0)
    return tree if isinstance(tree, dict) else {}


def _value(element: ElementTree.Element, path: Path, depth: int) -> Any:
    """Return text, number with unit, or children; repeated children are a list."""
    if depth > _DEEPEST:
        raise FormatError("is nested too deeply", path)
    if not len(element):
        text = (element.text or "").strip()
        unit = element.get("unit")
        return {"value": text, "unit": unit} if unit else text
    found: dict[str, Any] = {}
    for child in element:
        name, value = _local(child.tag), _value(child, path, depth + 1)
        if name not in found:
            found[name] = value
        elif isinstance(found[name], list):
            found[name].append(value)
        else:
            found[name] = [found[name], value]
    return found


def _local(tag: str) -> str:
    return tag.rsplit("}", 1)[-1]


def _at(tree: Any, *names: str) -> Any:
    """Return the value at `names`, the first of repeated ones; None if absent."""
    for name in names:
        tree = tree.get(name) if isinstance(tree, Mapping) else None
        tree = tree[0] if isinstance(tree, list) else tree
    return tree


def _all(tree: Any, name: str) -> list[Any]:
    """Return all children of a name."""
    found = tree.get(name) if isinstance(tree, Mapping) else None
    return [] if found is None else found if isinstance(found, list) else [found]


def _anywhere(tree: Any, name: str) -> list[Any]:
    """Return all elements of a name at any depth, in the order of the label."""
    found: list[Any] = []
    for key, value in tree.items() if isinstance(tree, Mapping) else ():
        for item in value if isinstance(value, list) else [value]:
            found += [item] if key == name else _anywhere(item, name)
    return found


def _first(tree: Any, *names: str) -> str | None:
    """Return the first text of one of `names` at any depth."""
    return next(
        (text for name in names for item in _anywhere(tree, name) if (text := text_of(item))), None
    )
