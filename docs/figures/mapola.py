"""From returns to a mapola."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fusion.report.layout import styled_figure
from fusion.report.maplets import hillshade
from fusion.workspace import Workspace
from lidar.scans.cubes import Box
from lidar.scan_store import ScanStore
from spcola.arrays import FloatArray
from spcola.grids import MapletGrid

ZOOM_CELLS = 5


def mapola_figure(workspace: Workspace) -> Figure:
    """Returns on some cells; the mapola; how many returns are in each cell; its sigma."""
    names = workspace.mapola_names()
    mapola = max(map(workspace.mapola, names), key=lambda one: np.isfinite(one.height).sum())
    grid = mapola.grid
    returns = ScanStore(workspace.scan_paths()).returns_inside(Box.over(grid, grid.radius))
    x, y, height = grid.project(returns.points)
    near = (np.abs(x) < ZOOM_CELLS) & (np.abs(y) < ZOOM_CELLS)
    with styled_figure(8.0, 7.2) as figure:
        panels: Any = figure.subplots(2, 2).ravel()
        points = panels[0].scatter(y[near], -x[near], c=height[near], s=7, cmap="viridis")
        points.set_clim(*np.percentile(height[near], (2, 98)))
        figure.colorbar(points, ax=panels[0], shrink=0.8, label="m")
        edges = np.arange(-ZOOM_CELLS, ZOOM_CELLS + 1) - 0.5
        panels[0].set(xticks=edges, yticks=edges, aspect="equal", title="returns on cells")
        panels[0].tick_params(labelbottom=False, labelleft=False, length=0)
        panels[0].grid(visible=True)
        shade = hillshade(mapola.height, grid.gsd)
        _image(panels[1], grid, shade, "gray").set_clim(0, 1)
        panels[1].set_title("median heights, shaded")
        count = _image(
            panels[2], grid, np.where(mapola.count > 0, mapola.count, np.nan).T, "viridis"
        )
        panels[2].set_title("returns in each cell")
        sigma = _image(panels[3], grid, 100 * mapola.sigma.T, "cividis")
        sigma.set_clim(0, np.nanpercentile(100 * mapola.sigma, 98))
        panels[3].set_title("sigma of the height")
        figure.colorbar(count, ax=panels[2], shrink=0.8)
        figure.colorbar(sigma, ax=panels[3], shrink=0.8, label="cm")
    return figure


def _image(panel: Any, grid: MapletGrid, image: FloatArray, colours: str) -> Any:
    half = (grid.half_size + 0.5) * grid.gsd
    panel.set(xticks=[], yticks=[])
    extent = (-half, half, -half, half)
    return panel.imshow(image, cmap=colours, extent=extent, interpolation="nearest")
