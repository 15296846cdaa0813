"""The coordinate reference system in the header of a LAS file."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from lidar.formats.records.options import LENGTH_UNITS_M
from spcola.errors import FormatError

Kind = Literal["not stated", "geocentric", "projected", "geographic"]

_USER, _WKT, _KEYS = "lasf_projection", 2112, 34735
# GeoTIFF keys: the kind of system, the codes of systems, and their units of length.
_MODEL, _GEOGRAPHIC, _PROJECTED, _UNIT, _VERTICAL, _VERTICAL_UNIT = (
    1024, 2048, 3072, 3076, 4096, 4099,
)  # fmt: skip
_MODELS: Mapping[int, Kind] = {1: "projected", 2: "geographic", 3: "geocentric"}
_EPSG_UNITS = {9001: 1.0, 9002: 0.3048, 9003: 1200.0 / 3937.0, 9036: 1e3}
# Codes that mean none, or one that the file describes itself.
_CODES = range(1024, 32767)
_LENGTH = r'UNIT\["[^"]*",\s*([0-9.eE+-]+)'
_METRE = 1e-6


@dataclass(frozen=True)
class LasSystem:
    """A coordinate reference system.

    Attributes
    ----------
    name : str
        As the file has it; empty if it states none.
    kind : {"not stated", "geocentric", "projected", "geographic"}
    unit_m, height_unit_m : float
        Metres in a unit of x and y, and of z; NaN where a file states none, or degrees.
    """

    name: str = ""
    kind: Kind = "not stated"
    unit_m: float = float("nan")
    height_unit_m: float = float("nan")

    def units_m(self, path: Path, chosen: str | None) -> tuple[float, float, float]:
        """Metres in a unit of x, of y and of z.

        Parameters
        ----------
        path : Path
            Path of the file, for the message.
        chosen : str or None
            Unit stated by the user.

        Raises
        ------
        FormatError
            If coordinates are longitude and latitude, or the user states another unit than the
            file.
        """
        if self.kind == "not stated":
            unit = LENGTH_UNITS_M[chosen or "m"]
            return unit, unit, unit
        where = f"{path}, header ({self.name})"
        if self.kind == "geographic":
            raise FormatError(
                "gives longitude and latitude in degrees, which are no lengths",
                where,
                "convert it to geocentric coordinates in metres first, e.g. with PDAL's "
                "filters.reprojection",
            )
        stated = (self.unit_m, self.unit_m, self.height_unit_m)
        if chosen is not None and any(
            abs(unit - LENGTH_UNITS_M[chosen]) > _METRE * unit for unit in stated
        ):
            raise FormatError(
                f"gives x and y in units of {self.unit_m:.7g} m and z of "
                f"{self.height_unit_m:.7g} m, not in {chosen}",
                where,
                "leave the unit out, or correct the coordinate system of the file",
            )
        return stated


def las_system(path: Path, header: Any, records: Iterable[Any]) -> LasSystem:
    """Return the coordinate reference system of a LAS file.

    Well-known text is used if the header states it or there are no GeoTIFF keys. Heights without a
    unit of their own have that of x and y.

    Parameters
    ----------
    path : Path
        For messages.
    header
        Header of laspy.
    records : iterable
        Variable-length records of laspy, extended ones too.

    Raises
    ------
    FormatError
        If a system is stated that cannot be read, or whose unit is unknown.
    """
    found = {
        record.record_id: bytes(record.record_data_bytes())
        for record in records
        if record.user_id.strip().lower() == _USER and record.record_id in (_WKT, _KEYS)
    }
    text = found.get(_WKT, b"").split(b"\0")[0].strip()
    keys = _keys(found.get(_KEYS, b""))
    if text and (header.global_encoding.wkt or not keys):
        return _of_text(path, text.decode("utf-8", errors="replace"))
    return _of_keys(path, keys) if keys else LasSystem()


def _keys(data: bytes) -> dict[int, int]:
    """Return the GeoTIFF keys whose values are whole numbers."""
    words = struct.unpack(f"<{len(data) // 2}H", data[: len(data) // 2 * 2])
    entries = (words[at : at + 4] for at in range(4, len(words) - 3, 4))
    return {key: value for key, place, _, value in entries if key and place == 0}


def _of_keys(path: Path, keys: dict[int, int]) -> LasSystem:
    """Return the system of GeoTIFF keys; those that are registered by their code."""
    kind = _MODELS.get(keys.get(_MODEL, 0))
    if kind is None:
        raise _unreadable(path, f"GeoTIFF model type {keys.get(_MODEL)}")
    code = keys.get(_GEOGRAPHIC if kind == "geographic" else _PROJECTED, 0)
    known = code in _CODES
    system = _of_text(path, f"EPSG:{code}") if known else LasSystem("GeoTIFF keys", kind)
    if kind == "geographic":
        return system if known else LasSystem("GeoTIFF keys", kind)
    unit = _EPSG_UNITS.get(keys.get(_UNIT, 0), system.unit_m)
    height = _EPSG_UNITS.get(keys.get(_VERTICAL_UNIT, 0), unit)
    vertical = keys.get(_VERTICAL, 0)
    if _VERTICAL_UNIT not in keys and vertical in _CODES:
        height = _of_text(path, f"EPSG:{vertical}").height_unit_m
    return _checked(path, LasSystem(system.name, kind, unit, height))


def _of_text(path: Path, text: str) -> LasSystem:
    """Return the system of well-known text, or of a registered code."""
    # GDAL is slow to import, and few files state a system.
    from rasterio.crs import CRS  # noqa: PLC0415
    from rasterio.errors import RasterioError  # noqa: PLC0415

    try:
        wkt = CRS.from_user_input(text).to_wkt(version="WKT1_GDAL")
    except (RasterioError, ValueError) as error:
        raise _unreadable(path, text[:60]) from error
    name = (re.findall(r'"([^"]*)"', wkt) or [""])[0]
    horizontal, _, vertical = wkt.partition("VERT_CS[")
    heights = re.findall(_LENGTH, vertical)
    if "PROJCS[" in horizontal or "GEOCCS[" in horizontal:
        kind: Kind = "projected" if "PROJCS[" in horizontal else "geocentric"
        lengths = re.findall(_LENGTH, horizontal)
        unit = float(lengths[-1]) if lengths else float("nan")
        return _checked(path, LasSystem(name, kind, unit, float(heights[-1]) if heights else unit))
    if "GEOGCS[" in horizontal:
        return LasSystem(name, "geographic")
    if heights:
        return LasSystem(name, "projected", float("nan"), float(heights[-1]))
    raise _unreadable(path, name)


def _checked(path: Path, system: LasSystem) -> LasSystem:
    """Return a system whose units are lengths."""
    if not (system.unit_m > 0 and system.height_unit_m > 0):
        raise _unreadable(path, f"{system.name}: unit not known")
    return system


def _unreadable(path: Path, what: str) -> FormatError:
    shown = " ".join(what.split())
    return FormatError(
        f"states a coordinate system that cannot be read ({shown})",
        f"{path}, header",
        "state it as well-known text, or remove it from the file and give --unit",
    )
