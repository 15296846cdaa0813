"""The three surfaces of one place: SPC, lidar, and both."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fusion.fusing.maplets import FusedMaplet, Source
from fusion.registration.results import transform_of
from fusion.report.layout import Colour, styled_figure
from fusion.report.maplets import hillshade
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.formats.maplets import read_maplet
from spcola.grids import Maplet, project_maplet


def fused_figure(workspace: Workspace) -> Figure:
    """The place where SPC and lidar each leave out most, on the grid of its fused maplet."""
    fused = max(map(workspace.fused, workspace.fused_names()), key=_need)
    with styled_figure(9.4, 2.9) as figure:
        panels: Any = figure.subplots(1, 4)
        draw_surfaces(panels[:3], fused, *both(workspace, fused))
        sigma = panels[3].imshow(100 * fused.sigma.T, cmap="cividis", interpolation="nearest")
        panels[3].set(xticks=[], yticks=[], title="sigma of the fused height")
        figure.colorbar(sigma, ax=panels.tolist(), shrink=0.7, pad=0.01, label="cm")
    return figure


def draw_surfaces(panels: Any, fused: FusedMaplet, spc: FloatArray, lidar: FloatArray) -> None:
    """Draw three hill-shades on one grid; what is unknown is green."""
    surfaces = {"SPC": spc, "lidar, registered": lidar, "fused": fused.height}
    for panel, (title, height) in zip(panels, surfaces.items(), strict=True):
        draw_shade(panel, height, fused.grid.gsd)
        panel.set_title(title)


def draw_shade(panel: Any, height: FloatArray, gsd: float) -> None:
    """Draw one hill-shade."""
    panel.set_facecolor(Colour.MISSING)
    panel.imshow(hillshade(height, gsd), cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    panel.set(xticks=[], yticks=[])


def _need(fused: FusedMaplet) -> float:
    """How much of a maplet rests on lidar alone, and how much on SPC alone, together."""
    return fused.share(Source.LIDAR) * fused.share(Source.IMAGE)


def both(workspace: Workspace, fused: FusedMaplet) -> tuple[FloatArray, FloatArray]:
    """SPC and registered lidar heights on the grid of a fused maplet."""
    spc = project_maplet(workspace.maplet(fused.name), fused.grid).height
    lidar = np.full(fused.grid.shape, np.nan)
    if fused.name in workspace.mapola_names():
        transform = transform_of(workspace.read_json("registration.json"), "registration.json")
        lidar = project_maplet(workspace.mapola(fused.name).moved(transform), fused.grid).height
    return spc, lidar


def bigmaps_figure(workspace: Workspace) -> Figure:
    """Bigmaps of the south pole: of SPC maplets, of returns, of fused maplets."""
    folder = workspace.root / "bigmaps"
    titles = {"maplets": "SPC maplets", "returns": "lidar returns", "": "fused maplets"}
    with styled_figure(9.4, 3.4) as figure:
        panels: Any = figure.subplots(1, 3)
        for panel, (below, title) in zip(panels, titles.items(), strict=True):
            bigmap: Maplet = read_maplet(folder / below / "SPOLE.MAP")
            draw_shade(panel, bigmap.height, bigmap.grid.gsd)
            panel.set_title(title)
    return figure
