"""What new maplets are seeded from: coarser maplets and the shape of a workspace."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from fusion.runtime import Progress
from fusion.stages.tiling.options import TilingOptions
from fusion.workspace import Workspace
from spcola.errors import SettingsError, WorkspaceError
from spcola.grids import Maplet, MapletGrid, overlaps
from spcola.shape import Mesh, RayCaster
from spcola.shape.tiling import mesh_of_maplets

# Maplets in memory at a time: new maplets that follow each other are neighbours.
_KEPT = 512
# GSDs in files have seven digits.
_SAME_GSD = 1.0 - 1e-6


class CoarserMaplets:
    """Maplets of a workspace by place, with the last few in memory.

    Parameters
    ----------
    workspace : Workspace
    grids : dict of str to MapletGrid
        Of those that may be used.
    """

    def __init__(self, workspace: Workspace, grids: dict[str, MapletGrid]) -> None:
        self._workspace = workspace
        self.grids = grids
        self._names = list(grids)
        self._widest = max((grid.radius for grid in grids.values()), default=0.0)
        self._tree = cKDTree(np.array([grid.center for grid in grids.values()]).reshape(-1, 3))
        self.read = lru_cache(_KEPT)(workspace.maplet)

    def __reduce__(self) -> tuple[type[CoarserMaplets], tuple[Workspace, dict[str, MapletGrid]]]:
        # Another process reads the maplets itself.
        return CoarserMaplets, (self._workspace, self.grids)

    def around(self, grid: MapletGrid) -> list[Maplet]:
        """Return the maplets that could share ground with a grid."""
        near = sorted(self._tree.query_ball_point(grid.center, grid.radius + self._widest))
        names = [self._names[k] for k in near]
        return [self.read(name) for name in names if overlaps(grid, self.grids[name])]


@dataclass(frozen=True, eq=False)
class Sources:
    """Coarser maplets, a shape, or both.

    Parameters
    ----------
    maplets : CoarserMaplets
        Empty if they are not used.
    shape : Mesh or None
    caster : RayCaster or None
        Of the shape.
    """

    maplets: CoarserMaplets
    shape: Mesh | None
    caster: RayCaster | None

    def surface(self, options: TilingOptions) -> Mesh:
        """Return the surface over which maplets are spread: the shape, or that of the maplets.

        Raises
        ------
        SettingsError
            If a maplet would be wider than the body.
        """
        half = options.gsd_m * options.half_size
        maplets = self.maplets
        mesh = self.shape or mesh_of_maplets(
            (maplets.read(name) for name in maplets.grids), 0.1 * half
        )
        radius = float(np.median(np.linalg.norm(mesh.vertices, axis=1)))
        if half > radius:
            raise SettingsError(
                f"of {options.gsd_m:g} m gives maplets {2 * half:.4g} m wide, on a body of "
                f"{radius:.4g} m radius",
                "--gsd",
                "lower it, or --half-size",
            )
        return mesh

    @property
    def shape_error(self) -> float:
        """Sigma of what the facets of the shape do not resolve, metres; 0 without a shape."""
        return 0.0 if self.shape is None else self.shape.missed_relief


def sources_of(workspace: Workspace, options: TilingOptions, progress: Progress) -> Sources:
    """Return what the maplets of a tiling are seeded from.

    Raises
    ------
    WorkspaceError
        If there is nothing, or a file cannot be read.
    SettingsError
        If the GSD is coarser than all maplets.
    """
    names = workspace.maplet_names() if options.source == "maplets" else []
    shape = workspace.shape() if workspace.has_shape() else None
    if shape is None and not names:
        also = "" if options.source == "shape" else " and no maplets in MAPFILES"
        raise WorkspaceError(
            f"there is no shape in SHAPEFILES{also} to take heights from",
            workspace.home,
            f"add some: spcola init {workspace.root} --spc DIR, or --shape FILE",
        )
    grids: dict[str, MapletGrid] = {}
    with progress.task("read maplets", len(names)) as task:
        for name in names:
            grids[name] = workspace.maplet(name).grid
            task.advance()
    coarser = {k: grid for k, grid in grids.items() if grid.gsd >= _SAME_GSD * options.gsd_m}
    if grids and not coarser:
        coarsest = max(grid.gsd for grid in grids.values())
        also = "" if shape is None else ", or --from shape"
        raise SettingsError(
            f"of {options.gsd_m:g} m is coarser than all {len(grids)} maplets to seed from, of "
            f"{coarsest:.4g} m at most",
            "--gsd",
            f"give {coarsest:.4g} or less{also}",
        )
    return Sources(
        CoarserMaplets(workspace, coarser), shape, None if shape is None else RayCaster(shape)
    )
