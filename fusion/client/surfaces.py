"""Calls that read surfaces and the shape, as arrays with their coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.client.arrays import mesh_of
from fusion.client.layers import ALL, SurfaceLayers, WholeWindow, Window
from fusion.client.place import View, Viewing
from fusion.client.steps import Steps, call
from spcola.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    import xarray as xr

# Cells of one request: a quarter of what a server gives at once.
_CELLS = 1 << 20


class Surfaces(Viewing):
    """Calls that read surfaces: maplets, mapolas, fused maplets, bigmaps, pairs, and the shape."""

    @call
    def surfaces(
        self, workspace: str, kind: str = "", *, solution: str = ""
    ) -> Steps[list[dict[str, str]]]:
        """Return `kind` and `name` of all surfaces, or of those of one kind.

        Parameters
        ----------
        workspace : str
        kind : str
            ``maplet``, ``mapola``, ``fused``, ``bigmap``, ``pair`` or ``dtm``.
        solution : str
        """
        content = yield from self._view(
            View.SURFACES, workspace, kind=kind or None, solution=solution
        )
        found: list[dict[str, str]] = content["surfaces"]
        return found

    @call
    def surface(
        self, workspace: str, kind: str, name: str, *, solution: str = ""
    ) -> Steps[dict[str, Any]]:
        """Return grid, layers, overview levels and ranges of values of a surface."""
        return (
            yield from self._view(View.SURFACE, workspace, kind=kind, name=name, solution=solution)
        )

    @call
    def window(
        self,
        workspace: str,
        kind: str,
        name: str,
        layer: str = "height",
        *,
        window: Window = ALL,
        solution: str = "",
    ) -> Steps[FloatArray]:
        """Return a window of a layer; by default all of it at full resolution.

        Parameters
        ----------
        workspace, kind, name : str
        layer : str
            ``height``, ``sigma``, ``albedo``, ``hillshade``, ``count``, ``source``,
            ``difference``, ``slope`` or ``directions``, as far as the surface has it.
        window : Window
        solution : str

        Returns
        -------
        (R, C) float32 ndarray
            Rows run down along Ux, columns to the right along Uy; NaN where unknown.
        """
        one = _One(workspace, kind, name, solution)
        found = window.on((yield from self._about(one)))
        return (yield from self._window(one, layer, found))

    @call
    def layers(
        self,
        workspace: str,
        kind: str,
        name: str,
        layers: Sequence[str] = (),
        *,
        window: Window = ALL,
        solution: str = "",
    ) -> Steps[SurfaceLayers]:
        """Return layers of a surface with their coordinates, units and frame, all by default."""
        return (yield from self._layers(_One(workspace, kind, name, solution), layers, window))

    @call
    def dataset(
        self,
        workspace: str,
        kind: str,
        name: str,
        layers: Sequence[str] = (),
        *,
        window: Window = ALL,
        solution: str = "",
    ) -> Steps[xr.Dataset]:
        """Return layers of a surface as an xarray.Dataset: see :class:`SurfaceLayers`.

        Raises
        ------
        SettingsError
            If xarray is not installed.
        """
        one = _One(workspace, kind, name, solution)
        return (yield from self._layers(one, layers, window)).to_xarray()

    @call
    def value(
        self, workspace: str, kind: str, name: str, x: float, y: float, *, solution: str = ""
    ) -> Steps[dict[str, Any]]:
        """Return all layers of a surface at a point, metres from its centre."""
        given = {"kind": kind, "name": name, "x": x, "y": y, "solution": solution}
        return (yield from self._view(View.VALUE, workspace, **given))

    @call
    def profile(
        self,
        workspace: str,
        kind: str,
        name: str,
        begin: tuple[float, float],
        end: tuple[float, float],
        *,
        layers: Sequence[str] = (),
        solution: str = "",
    ) -> Steps[dict[str, Any]]:
        """Return layers along a line as arrays (N,); NaN where unknown.

        Parameters
        ----------
        workspace, kind, name : str
        begin, end : (float, float)
            x along Uy and y along −Ux, metres from the centre.
        layers : sequence of str
            By default all but hillshade and slope.
        solution : str

        Returns
        -------
        dict
            `distance_m`, `x_m`, `y_m`, `longitude_deg`, `latitude_deg`, and `layers` by name.
        """
        ends = {key: f"{x!r},{y!r}" for key, (x, y) in (("from", begin), ("to", end))}
        given = {"kind": kind, "name": name, **ends, "solution": solution}
        found = yield from self._view(
            View.PROFILE, workspace, **given, layers=",".join(layers) or None
        )
        values = {key: _array(value) for key, value in found.items() if key != "layers"}
        return {**values, "layers": {key: _array(one) for key, one in found["layers"].items()}}

    @call
    def shape(
        self, workspace: str, *, facets: int | None = None, solution: str = ""
    ) -> Steps[tuple[FloatArray, IntArray]]:
        """Return the body's shape, with at most about as many `facets` if given.

        Returns
        -------
        vertices : (V, 3) ndarray
            Metres, body-fixed, rounded to float32 from the middle of the body.
        faces : (F, 3) ndarray
            Counter-clockwise seen from outside.
        """
        given = {"facets": facets, "solution": solution or None}
        return mesh_of((yield from self.place.content(View.SHAPE, workspace, given)))

    @call
    def shape_layers(self, workspace: str, *, solution: str = "") -> Steps[list[dict[str, Any]]]:
        """Return the layers on the shape, and of which kind of surface each one is taken."""
        content = yield from self._view(View.SHAPE_LAYERS, workspace, solution=solution)
        found: list[dict[str, Any]] = content["layers"]
        return found

    @call
    def shape_layer(
        self, workspace: str, layer: str, *, facets: int | None = None, solution: str = ""
    ) -> Steps[FloatArray]:
        """Return a layer (V,) on the vertices of the shape, float32; NaN where unknown."""
        given = {"layer": layer, "facets": facets, "solution": solution or None}
        content = yield from self.place.content(View.SHAPE_LAYER, workspace, given)
        return np.frombuffer(content, "<f4")

    def _about(self, one: _One) -> Steps[dict[str, Any]]:
        return (yield from self._view(View.SURFACE, one.workspace, **one.asked()))

    def _layers(self, one: _One, names: Sequence[str], window: Window) -> Steps[SurfaceLayers]:
        about = yield from self._about(one)
        found = window.on(about)
        values = {}
        for name in names or [layer["name"] for layer in about["layers"]]:
            values[name] = yield from self._window(one, name, found)
        return SurfaceLayers.of(about, found, values)

    def _window(self, one: _One, layer: str, window: WholeWindow) -> Steps[FloatArray]:
        """Return a window in as many parts as the server's limit takes."""
        (top, below), (left, beyond) = window.rows, window.columns
        step = max(1, _CELLS // max(1, beyond - left))
        parts = []
        for row in range(top, max(below, top + 1), step):
            count = min(step, below - row)
            given: Mapping[str, Any] = {
                **one.asked(), "layer": layer, "level": window.level,
                "row": row, "column": left, "rows": count, "columns": beyond - left,
                "format": "float32",
            }  # fmt: skip
            content = yield from self.place.content(View.WINDOW, one.workspace, given)
            parts.append(np.frombuffer(content, "<f4").reshape(count, beyond - left))
        return np.concatenate(parts)


@dataclass(frozen=True)
class _One:
    """One surface."""

    workspace: str
    kind: str
    name: str
    solution: str

    def asked(self) -> dict[str, Any]:
        """Return what a view of it is asked for."""
        return {"kind": self.kind, "name": self.name, "solution": self.solution or None}


def _array(values: Sequence[float | None]) -> FloatArray:
    """Return numbers of JSON, in which NaN is null."""
    return np.array(values, dtype=float)
