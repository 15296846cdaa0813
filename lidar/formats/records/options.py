"""Options of the readers of lidar files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from spcola.errors import SettingsError

LENGTH_UNITS_M: Mapping[str, float] = MappingProxyType(
    {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3}
)
"""Metres in one unit of length, by the unit's name."""


@dataclass(frozen=True)
class LidarOptions:
    """How lidar files are read; the defaults suit files that follow their format.

    Parameters
    ----------
    name : str, optional
        Name of the scan; the file's name without its suffix if not given.
    body, trajectory : str
        The body-fixed frame, and the trajectory by which the file's points were located.
    sigma_m : float
        One standard deviation of a single range, metres, where the file gives none (NaN: unknown).
    chunk : int
        Records in memory at once.
    columns : mapping of str to str
        For tables: quantity to column with its unit, such as ``{"x": "X [km]"}``.
    unit : {"m", "km", "cm", "mm"}, optional
        Unit of coordinates where the format has none of its own (LAS, PLY, PCD: metres if not
        given; track text: kilometres if not given).
    gps_time : bool
        Keep the GPS time of LAS returns (adjusted standard GPS time) as ephemeris time.
    reference_offset_m : float, optional
        Expected distance from spacecraft to point less the range, metres; the format's own if
        not given (OLA 1.15 m, LOLA 0.545 m, others 0).
    range_tolerance_m : float, optional
        A return is rejected if distance less range differs from the expected by more than this,
        metres, or if two positions of it differ by more; the format's own if not given.
    radius_limits_m : (float, float), optional
        Returns nearer to or further from the body's centre than this, metres, are rejected.

    Raises
    ------
    SettingsError
        If an option lies outside its range.
    """

    name: str | None = None
    body: str = "body-fixed"
    trajectory: str = "reference"
    sigma_m: float = math.nan
    chunk: int = 1_000_000
    columns: Mapping[str, str] = field(default_factory=dict)
    unit: str | None = None
    gps_time: bool = False
    reference_offset_m: float | None = None
    range_tolerance_m: float | None = None
    radius_limits_m: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "columns", MappingProxyType(dict(self.columns)))
        if self.chunk < 1:
            raise SettingsError("must be at least 1 record", "chunk")
        if self.sigma_m <= 0 or math.isinf(self.sigma_m):
            raise SettingsError("must be a positive number of metres", "sigma_m")
        if self.unit is not None and self.unit not in LENGTH_UNITS_M:
            known = ", ".join(LENGTH_UNITS_M)
            raise SettingsError(f"{self.unit!r} is not a unit of length", "unit", f"use {known}")
        if self.range_tolerance_m is not None and not self.range_tolerance_m > 0:
            raise SettingsError("must be a positive number of metres", "range_tolerance_m")
        if self.reference_offset_m is not None and not math.isfinite(self.reference_offset_m):
            raise SettingsError("must be a number of metres", "reference_offset_m")
        limits = self.radius_limits_m
        if limits is not None and not 0 <= limits[0] < limits[1]:
            raise SettingsError("must be a lower and a higher radius, metres", "radius_limits_m")

    def unit_m(self, convention: str) -> float:
        """Metres in the unit of the file's coordinates, `convention` where none is chosen."""
        return LENGTH_UNITS_M[self.unit or convention]
