"""Figure of one place: hillshades, differences, and sources of the fused heights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.report.data import Surfaces
from fusion.report.layout import styled_figure
from fusion.report.maplets import (
    bar_below,
    draw_differences,
    draw_sources,
    grid_image,
    hillshade,
    label_panels,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def surfaces_figure(place: Surfaces) -> Figure:
    """Nine panels: three surfaces, three differences, and sigma, lidar count, source."""
    grid = place.fused.grid
    fused = place.fused.height
    shades = {"SPC": place.spc, "lidar, registered": place.lidar, "fused": fused}
    gaps = {
        "fused − SPC": fused - place.spc,
        "fused − lidar": fused - place.lidar,
        "lidar − SPC": place.lidar - place.spc,
    }
    with styled_figure(9.4, 9.6) as figure:
        panels = figure.subplots(3, 3)
        for panel, (title, height) in zip(panels[0], shades.items(), strict=True):
            grid_image(panel, grid, hillshade(height, grid.gsd), "gray", (0.0, 1.0))
            panel.set_title(title)
        drawn = draw_differences(panels[1], grid, gaps)
        bar = figure.colorbar(drawn, ax=panels[1].tolist(), shrink=0.85, extend="both", pad=0.01)
        bar.set_label("height difference, m")
        _origins(figure, panels[2], place)
        label_panels(panels.flat, grid)
    return figure


def _origins(figure: Figure, panels: Any, place: Surfaces) -> None:
    """Draw sigma, count and source of the fused heights."""
    fused, grid = place.fused, place.fused.grid
    known = fused.sigma[np.isfinite(fused.sigma)]
    top = float(np.percentile(known, 99)) if known.size else 1.0
    sigma = grid_image(panels[0], grid, fused.sigma.T, "cividis", (0.0, max(top, 1e-6)))
    bar_below(figure, sigma, panels[0], "m", extend="max")
    panels[0].set_title("sigma of the fused height")
    most = max(1.0, float(np.percentile(fused.count, 99)))
    count = grid_image(panels[1], grid, fused.count.T.astype(float), "viridis", (0.0, most))
    bar_below(figure, count, panels[1], "returns in a cell", extend="max")
    panels[1].set_title("lidar returns")
    draw_sources(figure, panels[2], fused)
    panels[2].set_title("heights rest on")
