"""Layers of a surface with their coordinates, units and frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class SurfaceLayers:
    """Layers of a surface on one window.

    Attributes
    ----------
    x : (C,) ndarray
        To the right, along Uy, metres from the centre of the grid.
    y : (R,) ndarray
        Up, along −Ux, metres: the first row is the uppermost one.
    values : mapping of str to (R, C) float32 ndarray
        By layer; NaN where unknown.
    units, texts : mapping of str to str
        By layer: the unit, and what it is.
    about : mapping
        The surface: `kind`, `name`, `center_m`, `axes` (Ux, Uy, Uz; body-fixed), `gsd_m`,
        `longitude_deg`, `latitude_deg`, `radius_m`.
    """

    x: FloatArray
    y: FloatArray
    values: Mapping[str, FloatArray]
    units: Mapping[str, str]
    texts: Mapping[str, str]
    about: Mapping[str, Any]

    @classmethod
    def of(
        cls,
        about: Mapping[str, Any],
        level: int,
        spans: tuple[tuple[int, int], tuple[int, int]],
        values: Mapping[str, FloatArray],
    ) -> Self:
        """Return the layers `values` of a window of a surface that is described by `about`."""
        rows, columns = (_middles(span, level, about["size"]) for span in spans)
        half, gsd = (about["size"] - 1) // 2, about["gsd_m"]
        known = {layer["name"]: layer for layer in about["layers"]}
        names = ("kind", "name", "center_m", "axes", "gsd_m")
        place = ("longitude_deg", "latitude_deg", "radius_m")
        return cls(
            (columns - half) * gsd,
            (half - rows) * gsd,
            values,
            {name: known[name]["unit"] for name in values},
            {name: known[name]["text"] for name in values},
            {name: about[name] for name in (*names, *place)} | {"level": level},
        )

    def to_xarray(self) -> xr.Dataset:
        """Return an xarray.Dataset with the coordinates x and y, units, and the frame as CRS.

        The scalar coordinate ``crs`` has the frame in CF's way (`grid_mapping`): `crs_wkt` (WKT 2,
        the plane of the grid), centre and axes in the body-fixed frame. The point of a height h at
        x, y is ``center_m + x Uy − y Ux + h Uz``.

        Raises
        ------
        SettingsError
            If xarray is not installed.
        """
        try:
            import xarray as xr  # noqa: PLC0415
        except ImportError as error:
            raise SettingsError(
                "needs xarray", "dataset", "install it: pip install 'spcola[client]'"
            ) from error
        layers = {
            name: (
                ("y", "x"),
                values,
                {"units": self.units[name], "long_name": self.texts[name], "grid_mapping": "crs"},
            )
            for name, values in self.values.items()
        }
        axes = {
            "x": ("x", self.x, {"units": "m", "long_name": "along Uy", "axis": "X"}),
            "y": ("y", self.y, {"units": "m", "long_name": "along -Ux", "axis": "Y"}),
        }
        crs = dict(self.about)
        attributes = {key: crs.pop(key) for key in ("kind", "name")}
        crs |= dict(zip(("ux", "uy", "uz"), crs.pop("axes"), strict=True))
        crs |= {"crs_wkt": self.crs_wkt(), "frame": "body-fixed"}
        return xr.Dataset(layers, {**axes, "crs": ((), 0, crs)}, attributes)

    def crs_wkt(self) -> str:
        """Return the plane of the grid as an engineering CRS in WKT 2 (ISO 19162)."""
        name = f"{self.about['kind']} {self.about['name']}".replace('"', "")
        return (
            f'ENGCRS["plane of {name}",EDATUM["centre of {name}"],CS[Cartesian,2],'
            'AXIS["along Uy (x)",unspecified,ORDER[1]],AXIS["along -Ux (y)",unspecified,ORDER[2]],'
            'LENGTHUNIT["metre",1.0]]'
        )


def _middles(span: tuple[int, int], level: int, size: int) -> FloatArray:
    """Return the middles of cells of a level, in grid points; the last one may be smaller."""
    first = np.arange(*span) * level
    last = np.minimum(first + level, size) - 1
    return (first + last) / 2.0
