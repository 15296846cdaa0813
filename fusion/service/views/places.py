"""Where things lie, in JSON types."""

from __future__ import annotations

from typing import Any

import numpy as np

from spcola.arrays import FloatArray
from spcola.grids import MapletGrid
from spcola.math import lon_lat_deg


def place_json(point: FloatArray) -> dict[str, float]:
    """Return east longitude, latitude and distance from the centre of a point (3,), metres."""
    longitude, latitude = lon_lat_deg(point)
    return {
        "longitude_deg": float(longitude),
        "latitude_deg": float(latitude),
        "radius_m": float(np.linalg.norm(point)),
    }


def grid_json(grid: MapletGrid) -> dict[str, Any]:
    """Return the frame of a grid; `axes` are Ux (down), Uy (right) and Uz."""
    return {
        "center_m": grid.center.tolist(),
        "axes": grid.axes.tolist(),
        "gsd_m": grid.gsd,
        "size": grid.size,
        "side_m": (grid.size - 1) * grid.gsd,
        **place_json(grid.center),
    }
