"""The SPC surface of a workspace on any grid."""

from __future__ import annotations

from collections.abc import Callable

from fusion.surfacematch import Surface
from fusion.workspace import Workspace
from spcola.bigmap import BigmapOptions, make_bigmap
from spcola.grids import Maplet, MapletGrid, overlaps, project_maplet
from spcola.shape import RayCaster, shape_heights

Reference = Callable[[str, MapletGrid], Surface]
"""(name of a mapola, grid) → SPC surface on that grid."""


def surface_reference(workspace: Workspace, against: str) -> Reference:
    """Return the SPC surface on any grid: the maplet itself, a bigmap, or the shape.

    Parameters
    ----------
    workspace : Workspace
    against : {"maplets", "bigmap", "shape"}
        As in [register]; "maplets" falls back to a bigmap where a mapola has no maplet.

    Returns
    -------
    callable
        (name, grid) → heights and sigmas (2q+1, 2q+1), metres along the grid's Uz; NaN where SPC
        has none. A shape has no sigmas.
    """
    if against == "shape":
        caster = RayCaster(workspace.shape())
        return lambda _, grid: Surface(
            shape_heights(caster, grid, reach=grid.radius), of_slopes=False
        )
    grids = {name: workspace.maplet(name).grid for name in workspace.maplet_names()}

    def own(name: str, grid: MapletGrid) -> Surface:
        if name in grids and overlaps(grid, grids[name]):
            projected = project_maplet(workspace.maplet(name), grid)
            return Surface(projected.height, projected.sigma)
        return together(name, grid)

    def together(name: str, grid: MapletGrid) -> Surface:
        bigmap = make_bigmap(
            name, grid, maplets_around(workspace, grids, grid), options=BigmapOptions()
        )
        return Surface(bigmap.height, bigmap.sigma)

    return own if against == "maplets" else together


def maplets_around(
    workspace: Workspace, grids: dict[str, MapletGrid], grid: MapletGrid
) -> list[Maplet]:
    """Read the maplets that share ground with `grid`.

    Parameters
    ----------
    workspace : Workspace
    grids : dict of str to MapletGrid
        Grids of all maplets.
    grid : MapletGrid
    """
    return [workspace.maplet(name) for name, other in grids.items() if overlaps(grid, other)]
