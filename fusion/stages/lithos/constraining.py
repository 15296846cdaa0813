"""Heights that constrain a maplet: of the shape, other maplets, the lidar, limbs, maps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fusion.estimation.verdict import Verdict
from fusion.fusing import gives_means
from fusion.pipeline.solutions.lidar_content import LidarContent
from fusion.scene import Scene, maplets_around
from fusion.scene.geolocation import return_paths
from fusion.stages.lithos.limbs import Limbs
from fusion.stages.lithos.maps import ExternalMap, read_maps
from fusion.stages.lithos.options import ConstraintKind, LithosOptions, Purpose
from fusion.stages.lithos.returns import RegisteredReturns
from fusion.stages.register import ImageScene
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.errors import RejectedResultError, WorkspaceError
from spcola.grids import Maplet, MapletGrid, project_maplet
from spcola.photometry.photoclinometry import HeightConstraint
from spcola.shape import Mesh, RayCaster, shape_heights

# Points of a shape, and of a maplet, that share one error; of a coarser one, its own points. Those
# on a facet of the shape share it, however many they are.
_COMMON_SHAPE, _COMMON_MAPLET = 100.0, 400.0
# Least sigma of a shape, of the largest one, however well images agree with it: it may be made of
# the same ones.
_LEAST_SHAPE_SIGMA = 0.2
# Sigmas of the shape that a limb may lie from the shape's.
_FARTHEST = 3.0
# Sigma of the heights of a maplet that states none, grid steps.
_MAPLET_SIGMA = 0.5


@dataclass(frozen=True, eq=False)
class ConstrainingHeights:
    """All heights that may constrain the maplets of a workspace.

    Parameters
    ----------
    workspace : Workspace
    grids : dict of str to MapletGrid
        Of all maplets.
    shape : RayCaster, optional
        Only where it is asked for.
    scene : Scene, optional
        Registered mapolas; only where the lidar is asked for.
    returns : RegisteredReturns, optional
        Only where they are asked for.
    limbs : Limbs, optional
        Only where they are asked for.
    maps : tuple of ExternalMap
    options : LithosOptions
    """

    workspace: Workspace
    grids: dict[str, MapletGrid]
    shape: RayCaster | None
    scene: Scene | None
    returns: RegisteredReturns | None
    limbs: Limbs | None
    maps: tuple[ExternalMap, ...]
    options: LithosOptions

    @classmethod
    def of(
        cls,
        workspace: Workspace,
        grids: dict[str, MapletGrid],
        images: ImageScene,
        options: LithosOptions,
    ) -> ConstrainingHeights:
        """Read what is asked for.

        Raises
        ------
        WorkspaceError
            If the shape is asked for and there is none, or the lidar and it is not registered.
        RejectedResultError
            If the lidar is asked for, and the maplets that go into the result contain it already,
            its registration may not be used, or its mapolas are too coarse for the maplets.
        FormatError
            If a map cannot be read, or states no sigma.
        """
        asked = set(options.constraints)
        if {ConstraintKind.SHAPE, ConstraintKind.LIMBS} & asked and images.beyond is None:
            raise no_shape(workspace, options)
        lidar, returns = ConstraintKind.LIDAR in asked, ConstraintKind.RETURNS in asked
        if lidar or returns:
            check_lidar_once(workspace, options)
            check_registration(workspace, options.accepted)
        return cls(
            workspace,
            grids,
            images.beyond if ConstraintKind.SHAPE in asked else None,
            _mapolas(workspace, grids) if lidar else None,
            RegisteredReturns.of(workspace) if returns else None,
            _limbs(images, grids, options) if ConstraintKind.LIMBS in asked else None,
            read_maps(options.maps, options.map_sigma_m),
            options,
        )

    @property
    def names(self) -> list[str]:
        """Constraints that other data than maplets give, by the names of their heights."""
        given = {"lidar": self.scene, "returns": self.returns, "limbs": self.limbs}
        named = [name for name, source in given.items() if source is not None]
        return named + [one.name for one in self.maps]

    @property
    def paths(self) -> list[Path]:
        """Files from which heights come, but for those of the solution and the shape."""
        found = [one.path for one in self.maps]
        if self.scene is not None or self.returns is not None:
            found.append(self.workspace.registration_path)
        if self.returns is not None:
            found += return_paths(self.workspace, self.workspace.settings())
            if self.returns.source.adjustment is not None:
                found.append(self.workspace.adjustment_path)
        return found

    def on(self, start: Maplet) -> tuple[HeightConstraint, ...]:
        """Return the heights on the grid of a maplet, in the order of their kinds.

        Parameters
        ----------
        start : Maplet
            Heights known so far.
        """
        grid, slope_sigma = start.grid, self.options.photoclinometry.slope_sigma
        found = list[HeightConstraint | None]()
        if self.shape is not None:
            found.append(self._of_shape(self.shape, grid))
        found += self._maplets(start)
        if self.scene is not None:
            found.append(_of_mapolas(self.scene, start.name, grid))
        if self.returns is not None:
            found.append(self.returns.constraint(start, slope_sigma))
        if self.limbs is not None:
            found.append(self.limbs.constraint(start, slope_sigma))
        found += [map_.constraint(start) for map_ in self.maps]
        return tuple(one for one in found if one is not None)

    def _of_shape(self, shape: RayCaster, grid: MapletGrid) -> HeightConstraint:
        """Return those of the shape; without a sigma in the options, one that images lower.

        Facets are chords: all may lie below the ground by as much as their middles do.
        """
        given, largest = self.options.shape_sigma_m, _largest_shape_sigma(shape.mesh, grid.gsd)
        heights = shape_heights(shape, grid, reach=grid.radius)
        on_facet = 0.5 * (shape.mesh.facet_side / grid.gsd) ** 2
        common = min(max(_COMMON_SHAPE, on_facet), heights.size)
        found = HeightConstraint.of_sigma("shape", heights, given or largest, common=common)
        found = replace(found, shared_sigma=shape.mesh.sagitta)
        return found if given else replace(found, least_sigma=_LEAST_SHAPE_SIGMA * largest)

    def _maplets(self, start: Maplet) -> list[HeightConstraint]:
        """Return those of the maplets that overlap it, of the kinds that are asked for."""
        kinds, grid = self.options.constraints, start.grid
        if not {ConstraintKind.OVERLAPS, ConstraintKind.COARSER} & set(kinds):
            return []
        return [
            _overlap(other, grid)
            for other in maplets_around(self.workspace, self.grids, grid)
            if other.name != start.name and _kind_of(other.grid, grid) in kinds
        ]


def _of_mapolas(scene: Scene, name: str, grid: MapletGrid) -> HeightConstraint:
    """Return the heights of registered mapolas on the grid of a maplet: means over cells."""
    lidar, common = scene.lidar(name, grid, as_means=True), scene.common_covariance(name, grid)
    shared_sigma = float(np.sqrt(grid.uz @ common @ grid.uz))
    heights = HeightConstraint.of_sigma("lidar", lidar.height, lidar.sigma)
    return replace(heights, shared_sigma=shared_sigma, blur=lidar.blur)


def no_shape(workspace: Workspace, options: LithosOptions) -> WorkspaceError:
    """Return the error of a workspace that has no shape, and should have one by the options."""
    do = "leave it out: --start maplet --constraint overlaps"
    if options.secondary:
        do += ", without --secondary-light"
    if options.purpose is Purpose.SPCOLA:
        do = "leave limbs and secondary_light out of [lithos]"
    return WorkspaceError("has no shape", workspace.root, do)


def check_lidar_once(workspace: Workspace, options: LithosOptions) -> None:
    """Refuse lidar heights with maplets that contain them already, unless that is accepted.

    Raises
    ------
    RejectedResultError
        If maplets of the solution are start or constraints, and contain the lidar.
    """
    content = LidarContent.of(workspace) if options.uses_lidar_with_maplets else None
    if content is not None and (obstacle := content.obstacle(workspace, options.accepted)):
        raise RejectedResultError(obstacle, workspace.home)


def check_registration(workspace: Workspace, accepted: tuple[str, ...]) -> None:
    """Refuse a registration that the fusion would refuse.

    Raises
    ------
    WorkspaceError
        If there is none.
    RejectedResultError
        If the registration may not be used; `accepted` are codes of findings that may.
    """
    path = workspace.registration_path
    if not path.is_file():
        raise WorkspaceError(
            "has no registered lidar", workspace.root, f"run: spcola register {workspace.root}"
        )
    verdict = Verdict.from_json(workspace.read_json(path.name))
    if obstacle := verdict.obstacle(accepted):
        raise RejectedResultError(f"the registration is {obstacle}", path)


def _mapolas(workspace: Workspace, grids: dict[str, MapletGrid]) -> Scene:
    """Return the registered mapolas, if heights of some can constrain maplets."""
    scene = Scene.of(workspace, light="none")
    finest = min(scene.mapola_grids.values(), key=lambda grid: grid.gsd)
    if all(gives_means(finest, grid) for grid in grids.values()):
        raise RejectedResultError(
            f"mapolas of {finest.gsd:.3g} m are coarser than all maplets, and have no heights of "
            "their points",
            workspace.root / "mapolas",
            "use the returns themselves: --constraint returns, or [lithos] constraints",
        )
    return scene


def _limbs(images: ImageScene, grids: dict[str, MapletGrid], options: LithosOptions) -> Limbs:
    """Return the limbs of the shape, as far from it as it may be wrong."""
    assert images.beyond is not None
    usual = float(np.median([grid.gsd for grid in grids.values()]))
    sigma = options.shape_sigma_m or _largest_shape_sigma(images.beyond.mesh, usual)
    return Limbs(images, _FARTHEST * sigma)


def _largest_shape_sigma(shape: Mesh, gsd: float) -> float:
    """Return the largest likely sigma of a shape's heights on a grid of a GSD, all metres.

    What the grid is to show is not known from the shape, nor is what its facets do not resolve.
    """
    return max(gsd, shape.missed_relief)


def _kind_of(other: MapletGrid, grid: MapletGrid) -> ConstraintKind:
    """Return as what a maplet of another grid constrains."""
    return ConstraintKind.COARSER if gives_means(other, grid) else ConstraintKind.OVERLAPS


def _overlap(other: Maplet, grid: MapletGrid) -> HeightConstraint:
    """Return the heights of an overlapping maplet on a grid [24 – 27]."""
    there = project_maplet(other, grid)
    sigma: FloatArray = np.where(
        np.isfinite(there.sigma), there.sigma, _MAPLET_SIGMA * other.grid.gsd
    )
    common = _COMMON_MAPLET * max(1.0, other.grid.gsd / grid.gsd) ** 2
    return HeightConstraint.of_sigma(other.name, there.height, sigma, common=common)
