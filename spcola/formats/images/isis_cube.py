"""ISIS cubes: layout, special pixels, and what the label states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spcola.errors import FormatError
from spcola.formats.images.image_label import (
    ImageLabel,
    first_text,
    quantity,
    seconds,
    temperatures,
    text_of,
)
from spcola.formats.images.isis_label import group, read_gdal_label
from spcola.formats.images.special_values import SpecialValues
from spcola.formats.text import regular_size

# The types that GDAL reads; ISIS's rare ones of 4 and 8 bytes are refused by it.
_TYPES = {"UnsignedByte": "u1", "SignedWord": "i2", "UnsignedWord": "u2", "Real": "f4"}


def _real(*patterns: int) -> tuple[float, ...]:
    return tuple(float(v) for v in np.array(patterns, np.uint32).view(np.float32))


# ISIS's SpecialPixel.h: Null; LRS and LIS; HIS and HRS; least valid number.
_SPECIAL = {
    "UnsignedByte": SpecialValues((0,), (), (255,)),
    "SignedWord": SpecialValues((-32768,), (-32767, -32766), (-32765, -32764), -32752),
    "UnsignedWord": SpecialValues((0,), (1, 2), (65534, 65535)),
    "Real": SpecialValues(
        _real(0xFF7FFFFB), _real(0xFF7FFFFC, 0xFF7FFFFD), _real(0xFF7FFFFE, 0xFF7FFFFF),
        _real(0xFF7FFFFA)[0],
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class IsisCube:
    """The core of a cube.

    Parameters
    ----------
    pixel_path : Path
        File of the pixels: the cube, or what a detached label names.
    width, height, bands : int
    dtype : numpy.dtype
        Stored, with byte order.
    scale, base : float
        ``brightness = base + scale × stored`` (Multiplier and Base).
    special : SpecialValues
    label : ImageLabel
    """

    pixel_path: Path
    width: int
    height: int
    bands: int
    dtype: np.dtype[np.generic]
    scale: float
    base: float
    special: SpecialValues
    label: ImageLabel


def read_isis_cube(path: Path) -> IsisCube:
    """Return layout and label of an ISIS cube, attached or detached.

    Raises
    ------
    FormatError
        If the label cannot be read, or the file is shorter than it states.
    """
    keywords = read_gdal_label(path, "ISIS3")
    core = group(keywords, "IsisCube", "Core")
    dimensions, pixels = group(core, "Dimensions"), group(core, "Pixels")
    kind = str(pixels.get("Type"))
    if kind not in _TYPES:
        raise FormatError(f"has pixels of type {kind}, which are not read", path)
    width, height, bands = (_whole(dimensions, key, path) for key in ("Samples", "Lines", "Bands"))
    order = {"Lsb": "<", "Msb": ">"}.get(str(pixels.get("ByteOrder")))
    if order is None:
        raise FormatError("has no ByteOrder (Lsb or Msb)", path)
    dtype = np.dtype(order + _TYPES[kind])
    detached = text_of(core.get("^Core"))
    pixel_path = path.parent / Path(detached).name if detached else path
    if str(core.get("Format")) in ("Tile", "BandSequential"):
        _check_length(pixel_path, core, (bands, height, width), dtype.itemsize)
    multiplier, base = (quantity(pixels.get(key)) for key in ("Multiplier", "Base"))
    return IsisCube(
        pixel_path, width, height, bands, dtype,
        multiplier[0] if multiplier else 1.0, base[0] if base else 0.0,
        _SPECIAL[kind], isis_label(keywords, path.name),
    )  # fmt: skip


def isis_label(keywords: Mapping[str, Any], file_name: str) -> ImageLabel:
    """Return what the groups Instrument, Archive and BandBin state.

    An exposure time without a unit is not used: ISIS's labels have milliseconds and seconds.
    """
    instrument, archive, bands = (
        group(keywords, "IsisCube", name) for name in ("Instrument", "Archive", "BandBin")
    )
    raw = instrument.get("ExposureDuration")
    found = quantity(raw)
    bare = found is not None and found[1] is None
    return ImageLabel(
        name=first_text(archive, "ProductId", "SourceProductId") or file_name,
        target=first_text(instrument, "TargetName"),
        instrument=first_text(instrument, "InstrumentId", "InstrumentName"),
        filter=first_text(bands, "FilterName", "Name", "FilterNumber"),
        start_utc=first_text(instrument, "StartTime"),
        stop_utc=first_text(instrument, "StopTime"),
        mid_utc=first_text(instrument, "MidObservationTime"),
        exposure_s=seconds(raw, without_unit=None),
        line_exposure_s=seconds(instrument.get("LineExposureDuration"), without_unit=None),
        clock_start=first_text(instrument, "SpacecraftClockStartCount", "SpacecraftClockCount"),
        clock_stop=first_text(instrument, "SpacecraftClockStopCount"),
        temperatures_k=temperatures(instrument),
        keywords=keywords,
        notes=("ExposureDuration has no unit and is not used",) if bare else (),
    )


def _check_length(
    path: Path, core: Mapping[str, Any], size: tuple[int, int, int], itemsize: int
) -> None:
    """Refuse a file that is shorter than its core."""
    bands, lines, samples = size
    start = _whole(core, "StartByte", path)
    if core.get("Format") == "Tile":
        tile_lines, tile_samples = (_whole(core, key, path) for key in ("TileLines", "TileSamples"))
        lines = -(-lines // tile_lines) * tile_lines
        samples = -(-samples // tile_samples) * tile_samples
    needed = start - 1 + bands * lines * samples * itemsize
    try:
        length = regular_size(path)
    except OSError as error:
        raise FormatError(f"cannot be read ({error.strerror or error})", path) from error
    if length < needed:
        raise FormatError(
            f"has {length} bytes, its label needs {needed}",
            path,
            "the file is truncated, or the label is another cube's",
        )


def _whole(entry: Mapping[str, Any], key: str, path: Path) -> int:
    """Return a positive whole number of the label."""
    value = entry.get(key)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value < 1 << 40:
        raise FormatError(f"has no usable {key} ({value!r})", path)
    return value
