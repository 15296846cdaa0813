"""Tables of times and directions to the Sun (CSV), for states whose source has neither.

Columns are ``image`` (or ``name``, ``file``, ``picture``), ``et``, ``utc`` or ``time`` (the middle
of the exposure), and ``sunx``, ``suny``, ``sunz`` or ``subsolar_lat_deg``, ``subsolar_lon_deg``
(east), body-fixed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from spcola.arrays import FloatArray
from spcola.formats.states.columns import Row, image_rows


class TimeAndSun(NamedTuple):
    """Time and light of an image.

    Attributes
    ----------
    time : float
        Middle of the exposure, ephemeris time, s; NaN if unknown.
    sun : (3,) ndarray
        Unit vector to the Sun, body-fixed; NaN if unknown.
    """

    time: float
    sun: FloatArray


def read_times(
    path: str | Path, *, columns: Mapping[str, str] | None = None
) -> dict[str, TimeAndSun]:
    """Read times and directions to the Sun, by the name of the image.

    Parameters
    ----------
    path : str or Path
    columns : mapping of str to str, optional
        For names of this module, those in the file.

    Raises
    ------
    FormatError
        If a value is no number or time, or an image appears twice.
    """
    rows = image_rows(path, columns or {})
    return {name: TimeAndSun(row.time_or_nan(), _sun(row)) for name, row in rows.items()}


def _sun(row: Row) -> FloatArray:
    """Return the unit vector to the Sun."""
    vector = row.numbers(("sunx", "suny", "sunz"))
    angles = row.numbers(("subsolar_lat_deg", "subsolar_lon_deg"))
    if vector is not None:
        length = float(np.linalg.norm(vector))
        return vector / length if length > 0.0 else np.full(3, np.nan)
    if angles is None:
        return np.full(3, np.nan)
    lat, lon = np.radians(angles)
    return np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
