"""Windows of a surface, and layers on them with their coordinates, units and frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError, SettingsError

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Window:
    """Part of a surface, at an overview level; by default all of it at full resolution.

    Parameters
    ----------
    level : int
        Grid points on a cell's side: 1, 2, 4, …
    rows, columns : (int, int), optional
        First cell of the level, and one beyond the last; by default all.

    Examples
    --------
    >>> Window(level=4, rows=(0, 256))
    Window(level=4, rows=(0, 256), columns=None)
    """

    level: int = 1
    rows: tuple[int, int] | None = None
    columns: tuple[int, int] | None = None

    def on(self, about: Mapping[str, Any]) -> WholeWindow:
        """Return the window on the surface that is described by `about`.

        Raises
        ------
        InvalidValueError
            If the surface has no such level, or rows or columns are not inside of it.
        """
        cells = {each["level"]: each["cells"] for each in about["levels"]}
        if self.level not in cells:
            there = ", ".join(map(str, cells))
            what = f"has no level {self.level}"
            raise InvalidValueError(what, about["name"], f"there are: {there}")
        most = cells[self.level]
        found = WholeWindow(self.level, self.rows or (0, most), self.columns or (0, most))
        for what, (low, high) in (("rows", found.rows), ("columns", found.columns)):
            if not 0 <= low < high <= most:
                raise InvalidValueError(
                    f"{what} {low} to {high} are not inside 0 to {most} of level {self.level}",
                    about["name"],
                )
        return found


ALL = Window()
"""All of a surface at full resolution."""


@dataclass(frozen=True)
class WholeWindow:
    """A window of which rows and columns are known."""

    level: int
    rows: tuple[int, int]
    columns: tuple[int, int]


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
        cls, about: Mapping[str, Any], window: WholeWindow, values: Mapping[str, FloatArray]
    ) -> Self:
        """Return the layers `values` of a window of a surface that is described by `about`."""
        level, size = window.level, about["size"]
        rows, columns = (_middles(span, level, size) for span in (window.rows, window.columns))
        half, gsd = (size - 1) // 2, about["gsd_m"]
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
