"""Data around one maplet of a workspace: mapolas, registration, images, shape."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fusion.fusing import (
    Constraints,
    FuseInput,
    FuseOptions,
    FuseResult,
    RegisteredMapola,
    fuse_maplet,
    lidar_constraints,
)
from fusion.fusing.uncertainty import (
    AlignedHeights,
    ImageSlopes,
    SlopeInformation,
    estimate_information,
)
from fusion.registration.results import (
    MapolaRegistration,
    given_registration,
    mapola_registrations,
    transform_of,
)
from fusion.registration.transform import KnownTransform
from fusion.scene.exposures import Exposures
from fusion.scene.surfaces import maplets_around
from fusion.workspace import Workspace
from lidar.gridding import Mapola
from spcola.arrays import FloatArray
from spcola.bigmap import make_bigmap
from spcola.grids import Maplet, MapletGrid, overlaps, project_maplet
from spcola.math import Affine
from spcola.photometry import SlopeVariance
from spcola.shape import RayCaster, shape_heights

# A mapola whose grid points lie within this many cells of the maplet's: the result has its grid.
_SAME_PLACE = 2.0
# Largest number of maplets compared for the errors of the whole solution.
_SAMPLE = 24

LightSource = Literal["auto", "images", "sun", "none"]
Run = Callable[[Callable[[str], AlignedHeights | None], list[str]], Iterable[AlignedHeights | None]]


@dataclass(frozen=True, eq=False)
class Scene:
    """Data of a workspace that the fusion of single maplets uses.

    Attributes
    ----------
    workspace : Workspace
    transform : Affine
        Lidar → SPC.
    placements : dict of str to MapolaRegistration
        Registration of each mapola relative to `transform`.
    grids, mapola_grids : dict of str to MapletGrid
        Grids of the maplets, and of the mapolas in SPC coordinates.
    prior : callable
        Grid → heights of the shape on it.
    illumination : ImageSlopes, optional
        The images from which the slopes come.
    """

    workspace: Workspace
    transform: Affine
    placements: dict[str, MapolaRegistration]
    grids: dict[str, MapletGrid]
    mapola_grids: dict[str, MapletGrid]
    prior: Callable[[MapletGrid], FloatArray]
    illumination: ImageSlopes | None

    @classmethod
    def of(cls, workspace: Workspace, *, light: LightSource = "auto") -> Scene:
        """Read registration and grids; the layers of maplets and mapolas are read on demand.

        Parameters
        ----------
        workspace : Workspace
            Registered.
        light : {"auto", "images", "sun", "none"}
            What determines where SPC has slopes, as ``[fuse] light``.

        Raises
        ------
        WorkspaceError
            If the workspace is not registered.
        InvalidValueError
            If its registration was refused or is not valid.
        """
        path = workspace.registration_path
        registration = workspace.read_json(path.name)
        transform = transform_of(registration, str(path))
        placements = mapola_registrations(registration, str(path))
        grids = {name: workspace.maplet(name).grid for name in workspace.maplet_names()}
        mapolas = {
            name: placements[name].grid(workspace.mapola(name).grid, transform)
            for name in workspace.mapola_names()
        }
        lit = _illumination(workspace, list(grids.values()), light)
        return cls(workspace, transform, placements, grids, mapolas, _prior(workspace), lit)

    @property
    def targets(self) -> list[str]:
        """Names to be fused: all maplets, and the mapolas that have no maplet."""
        return [*self.grids, *(name for name in self.mapola_grids if name not in self.grids)]

    def grid_of(self, name: str) -> MapletGrid:
        """Return the grid of the maplet or mapola from which `name` is fused."""
        return self.grids.get(name) or self.mapola_grids[name]

    def parts(self, name: str) -> FuseInput:
        """Gather the input of the fused maplet `name`."""
        spc = self._spc(name)
        light = self._light(spc)
        return FuseInput(
            name=name,
            grid=spc.grid,
            spc=_where_lit(spc, light),
            lidar=self.lidar(name, spc.grid),
            prior=self._shape(spc),
            common_covariance=self.common_covariance(name, spc.grid),
            light=light,
        )

    def comparison(self, name: str) -> AlignedHeights | None:
        """Lidar and SPC heights of the maplet `name`, aligned; None without a common point."""
        spc = self._spc(name)
        light = self._light(spc)
        lidar = self.lidar(name, spc.grid)
        if not (spc.valid & np.isfinite(lidar.height)).any():
            return None
        known, shape = _where_lit(spc, light), self._shape(spc)
        return AlignedHeights(lidar.height, known.height, lidar.sigma, spc.grid.gsd, light, shape)

    def information(self, run: Run = map) -> SlopeInformation:
        """Estimate the errors of slopes and heights from a sample of maplets.

        Parameters
        ----------
        run : callable, optional
            A function like `map`; the program passes one that uses all cores.
        """
        sample = self.targets[:: max(1, -(-len(self.targets) // _SAMPLE))]
        compared = run(self.comparison, sample)
        return estimate_information([pair for pair in compared if pair is not None])

    def fuse(
        self,
        name: str,
        information: SlopeInformation | None = None,
        *,
        options: FuseOptions | None = None,
    ) -> FuseResult:
        """Fuse the maplet `name` (:func:`fusion.fusing.fuse_maplet`); nothing is written.

        Parameters
        ----------
        name : str
            One of `targets`.
        information : SlopeInformation, optional
            Of :meth:`information`, estimated anew if not given: keep it to fuse several maplets.
        options : FuseOptions, optional
        """
        return fuse_maplet(self.parts(name), information or self.information(), options=options)

    def _shape(self, spc: Maplet) -> FloatArray:
        """Heights of the shape on a maplet's grid; without a shape, the maplet's own heights."""
        height = self.prior(spc.grid)
        return height if np.isfinite(height).any() else spc.height

    def _light(self, spc: Maplet) -> SlopeVariance | None:
        """Variance of a maplet's slopes from images; None where it is not known."""
        return None if self.illumination is None else self.illumination.variance(spc)

    def _spc(self, name: str) -> Maplet:
        """The SPC maplet on the grid of the result.

        Its centre is moved onto the registered lidar by the residual of its own match: slopes of a
        displaced maplet would blur every boulder. Where a mapola lies at the same place the result
        has the mapola's grid, so that the smooth SPC heights are interpolated rather than the
        sharper lidar heights.
        """
        if name not in self.grids:
            grid = self.mapola_grids[name]
            around = maplets_around(self.workspace, self.grids, grid)
            return make_bigmap(name, grid, around)
        maplet = self.workspace.maplet(name)
        placement = self.placements.get(name)
        if placement is None or not np.isfinite(placement.residual).all():
            return maplet
        grid = replace(maplet.grid, center=maplet.grid.center - placement.residual)
        moved = replace(maplet, grid=grid, center_sigma=np.zeros(3))
        if not _is_same_place(grid, self.mapola_grids[name]):
            return moved
        there = project_maplet(moved, self.mapola_grids[name])
        return Maplet(
            name,
            self.mapola_grids[name],
            there.height,
            albedo=there.albedo,
            sigma=there.sigma,
            center_sigma=np.zeros(3),
        )

    def lidar(self, name: str, grid: MapletGrid, *, as_means: bool = False) -> Constraints:
        """Return the heights of registered mapolas on a grid, that of the place `name` first.

        They are those at the points, or `as_means` with their blur.
        """
        return lidar_constraints(grid, self._candidates(self.near(name, grid)), as_means=as_means)

    def common_covariance(self, name: str, grid: MapletGrid) -> FloatArray:
        """Return the covariance (3, 3), m², of the error that all lidar heights on a grid share.

        It is the error of registration of the first mapola; 0 without any.

        Parameters
        ----------
        name : str
            Of the place.
        grid : MapletGrid
        """
        near = self.near(name, grid)
        return self.placements[near[0]].covariance if near else np.zeros((3, 3))

    def near(self, name: str, grid: MapletGrid) -> list[str]:
        """Mapolas over `grid`: that of the place `name` first, then the nearest."""

        def order(other: str) -> tuple[bool, float]:
            away = float(np.linalg.norm(self.mapola_grids[other].center - grid.center))
            return (other != name, away)

        return sorted(
            (other for other, place in self.mapola_grids.items() if overlaps(grid, place)),
            key=order,
        )

    def _candidates(self, names: list[str]) -> list[RegisteredMapola]:
        """Registered mapolas as candidates, read on demand."""

        def loader(name: str) -> Callable[[], Mapola]:
            return lambda: replace(self.workspace.mapola(name), grid=self.mapola_grids[name])

        return [RegisteredMapola(self.mapola_grids[name], loader(name)) for name in names]


def read_registration(workspace: Workspace) -> KnownTransform:
    """Read the transform from lidar to SPC coordinates of a registered workspace.

    Parameters
    ----------
    workspace : Workspace

    Returns
    -------
    KnownTransform
        ``transform.apply(points)`` moves points (N, 3), metres, from lidar to SPC coordinates;
        ``position_covariance(points)`` is the covariance of their positions, m². Displacements of
        single scans are not in it.

    Raises
    ------
    WorkspaceError
        If the workspace is not registered.
    InvalidValueError
        If its registration was refused or is not valid.
    """
    path = workspace.registration_path
    return given_registration(workspace.read_json(path.name), str(path)).known


def _where_lit(spc: Maplet, light: SlopeVariance | None) -> Maplet:
    """Return the maplet with NaN where images do not determine its slopes."""
    if light is None:
        return spc
    return replace(spc, height=np.where(light.at_points, spc.height, np.nan))


def _illumination(
    workspace: Workspace, grids: list[MapletGrid], light: LightSource
) -> ImageSlopes | None:
    """Images of the workspace as a source of slopes; None without images or if light is "none"."""
    if light == "none":
        return None
    images = tuple(workspace.images())
    if not images:
        return None
    exposed = Exposures(workspace)
    if light == "auto":
        return ImageSlopes.of(images, grids, exposed)
    return ImageSlopes(images, light, exposed)


def _is_same_place(one: MapletGrid, other: MapletGrid) -> bool:
    """Return whether two grids have the same size, and points less than two cells apart."""
    if (one.half_size, one.gsd) != (other.half_size, other.gsd):
        return False
    flat = np.zeros(one.shape)
    apart = np.linalg.norm(one.points(flat) - other.points(flat), axis=-1)
    return float(apart.max()) < _SAME_PLACE * one.gsd


def _prior(workspace: Workspace) -> Callable[[MapletGrid], FloatArray]:
    """Return a function grid → heights of the shape; all NaN if there is no shape."""
    if not workspace.has_shape():
        return lambda grid: np.full(grid.shape, np.nan)
    caster = RayCaster(workspace.shape())
    return lambda grid: shape_heights(caster, grid, reach=grid.radius)
