"""Fuse: SPC maplets and registered mapolas become fused maplets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from fusion.estimation.verdict import (
    Code,
    Finding,
    Severity,
    Verdict,
)
from fusion.fusing import (
    Candidate,
    Comparison,
    FuseInput,
    FuseOptions,
    FuseResult,
    Illumination,
    SlopeInformation,
    estimate_information,
    fuse_maplet,
    lidar_constraints,
    overlaps,
)
from fusion.fusing.maplets import FusedMaplet, Source, write_fused
from fusion.pipeline import StageContext, StageResult, find_table
from fusion.registration.results import Placement, placements_of, transform_of
from fusion.scene import Exposures, maplets_around
from fusion.workspace import Workspace, make_folder
from fusion.workspace.settings import BodySettings, FuseSettings, Settings, Table
from lidar.gridding import Mapola
from spcola.arrays import FloatArray
from spcola.bigmap import make_bigmap
from spcola.grids import Maplet, MapletGrid, project_maplet
from spcola.math import Affine
from spcola.photometry import SlopeVariance
from spcola.shape import RayCaster, shape_heights


@dataclass(frozen=True)
class FuseStage:
    """Maplets, mapolas, registration → fused maplets."""

    name: str = "fuse"
    version: int = 8
    needs: tuple[str, ...] = ("mapolas", "register")
    places: tuple[str, ...] = ("fused",)
    tables: tuple[type[Table], ...] = (FuseSettings, BodySettings)

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why there is nothing to fuse."""
        if not workspace.registration_path.is_file():
            return f"there is no registration; run: spcola register {workspace.root}"
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return registration, mapolas, maplets, images, and the shape where there is one."""
        lit = find_table(settings, FuseSettings).light != "none"
        return [
            workspace.registration_path,
            *workspace.mapola_paths(),
            *workspace.maplet_files(),
            *(workspace.image_files() if lit else []),
            *([workspace.shape_path()] if workspace.has_shape() else []),
        ]

    def run(self, context: StageContext) -> StageResult:
        """Estimate how much slopes and heights know, then fuse every maplet."""
        workspace, table = context.workspace, context.table(FuseSettings)
        scene = Scene.of(workspace, light=table.light)
        sample = scene.targets[:: max(1, -(-len(scene.targets) // _SAMPLE))]
        compared = context.map("compare lidar and SPC", scene.comparison, sample)
        information = estimate_information([pair for pair in compared if pair is not None])
        options = FuseOptions(
            loss=table.loss,
            fraction=table.constraint_fraction,
            seed=table.seed,
            fill_sigma_m=table.fill_sigma_m,
        )
        tally = _Tally()

        def fused(name: str) -> FuseResult:
            return fuse_maplet(scene.parts(name), information, options=options)

        done = context.stream("fuse maplets", fused, scene.targets, total=len(scene.targets))
        folder = workspace.root / "fused"
        make_folder(folder)
        write_fused(folder, tally.passed(done))
        summary = {**tally.summary(information), **tally.verdict().as_json()}
        return StageResult(tuple(workspace.fused_paths()), summary)


STAGE = FuseStage()

# A mapola whose grid points lie within so many steps of the maplet's gives the result its grid.
_SAME_PLACE = 2.0
# Differences of lidar and SPC in one maplet, over those of the solution, that are no chance: in
# right input they lie within 0.8 and 1.4.
_CONTRADICTS = 3.0
# Maplets named in a finding.
_NAMED = 5
# The information is one for the whole solution; at most this many maplets tell it.
_SAMPLE = 24

LightSource = Literal["auto", "images", "sun", "none"]


@dataclass(frozen=True, eq=False)
class Scene:
    """What the fusion of one maplet may need of the workspace.

    Attributes
    ----------
    workspace : Workspace
    transform : Affine
        Lidar → SPC.
    placements : dict of str to Placement
        How each mapola is registered beside that.
    grids, mapola_grids : dict of str to MapletGrid
        Of the maplets; of the mapolas in SPC coordinates.
    prior : callable
        Heights of the shape on a grid.
    illumination : Illumination, optional
        The images that the slopes come from.
    """

    workspace: Workspace
    transform: Affine
    placements: dict[str, Placement]
    grids: dict[str, MapletGrid]
    mapola_grids: dict[str, MapletGrid]
    prior: Callable[[MapletGrid], FloatArray]
    illumination: Illumination | None

    @classmethod
    def of(cls, workspace: Workspace, *, light: LightSource = "auto") -> Scene:
        """Read the frame of the scene; maplets and mapolas are read when their turn comes."""
        path = workspace.registration_path
        registration = workspace.read_json(path.name)
        transform = transform_of(registration, str(path))
        placements = placements_of(registration, str(path))
        grids = {name: workspace.maplet(name).grid for name in workspace.maplet_names()}
        mapolas = {
            name: placements[name].grid(workspace.mapola(name).grid, transform)
            for name in workspace.mapola_names()
        }
        lit = _illumination(workspace, list(grids.values()), light)
        return cls(workspace, transform, placements, grids, mapolas, _prior(workspace), lit)

    @property
    def targets(self) -> list[str]:
        """Names to be fused: all maplets, and the mapolas of places without one."""
        return [*self.grids, *(name for name in self.mapola_grids if name not in self.grids)]

    def parts(self, name: str) -> FuseInput:
        """Gather what goes into the fused maplet `name`."""
        spc = self._spc(name)
        light = self._light(spc)
        near = self.near(name, spc.grid)
        # What all lidar heights share is where the first of their mapolas is registered.
        common = self.placements[near[0]].covariance if near else np.zeros((3, 3))
        return FuseInput(
            name=name,
            grid=spc.grid,
            spc=_where_lit(spc, light),
            lidar=lidar_constraints(spc.grid, self._candidates(near)),
            prior=self._shape(spc),
            common_covariance=common,
            light=light,
        )

    def comparison(self, name: str) -> Comparison | None:
        """Lidar and SPC heights of one maplet, aligned; None where they do not meet."""
        spc = self._spc(name)
        light = self._light(spc)
        lidar = lidar_constraints(spc.grid, self._candidates(self.near(name, spc.grid)))
        if not (spc.valid & np.isfinite(lidar.height)).any():
            return None
        known, shape = _where_lit(spc, light), self._shape(spc)
        return Comparison(lidar.height, known.height, lidar.sigma, spc.grid.gsd, light, shape)

    def _shape(self, spc: Maplet) -> FloatArray:
        """Heights of the shape on the grid of a maplet; without one, those that SPC filled in."""
        height = self.prior(spc.grid)
        return height if np.isfinite(height).any() else spc.height

    def _light(self, spc: Maplet) -> SlopeVariance | None:
        """What images tell of the slopes of a maplet; None where that is not known."""
        return None if self.illumination is None else self.illumination.variance(spc)

    def _spc(self, name: str) -> Maplet:
        """The SPC maplet on the grid of the result.

        Its centre is moved onto the registered lidar by what its own match says, as SPC itself
        would solve it anew: slopes of a displaced maplet would blur every boulder. Where a mapola
        lies on the same place the result has the mapola's grid, so that it is the smooth SPC
        heights that are interpolated and not the sharp ones of the lidar.
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

    def near(self, name: str, grid: MapletGrid) -> list[str]:
        """Mapolas over `grid`: the one of the same place first, then the nearest."""

        def order(other: str) -> tuple[bool, float]:
            away = float(np.linalg.norm(self.mapola_grids[other].center - grid.center))
            return (other != name, away)

        return sorted(
            (other for other, place in self.mapola_grids.items() if overlaps(grid, place)),
            key=order,
        )

    def _candidates(self, names: list[str]) -> list[Candidate]:
        """Registered mapolas."""

        def loader(name: str) -> Callable[[], Mapola]:
            return lambda: replace(self.workspace.mapola(name), grid=self.mapola_grids[name])

        return [Candidate(self.mapola_grids[name], loader(name)) for name in names]


def _where_lit(spc: Maplet, light: SlopeVariance | None) -> Maplet:
    """The maplet where images determine its slopes."""
    if light is None:
        return spc
    return replace(spc, height=np.where(light.defined, spc.height, np.nan))


def _illumination(
    workspace: Workspace, grids: list[MapletGrid], light: LightSource
) -> Illumination | None:
    """The images of the workspace as a source of slopes; None if there are none, or by choice."""
    if light == "none":
        return None
    images = tuple(workspace.images())
    if not images:
        return None
    exposed = Exposures(workspace)
    if light == "auto":
        return Illumination.of(images, grids, exposed)
    return Illumination(images, light, exposed)


def _is_same_place(one: MapletGrid, other: MapletGrid) -> bool:
    """Whether two grids have one size and lie on each other to a cell or so."""
    if (one.half_size, one.gsd) != (other.half_size, other.gsd):
        return False
    flat = np.zeros(one.shape)
    apart = np.linalg.norm(one.points(flat) - other.points(flat), axis=-1)
    return float(apart.max()) < _SAME_PLACE * one.gsd


def _prior(workspace: Workspace) -> Callable[[MapletGrid], FloatArray]:
    """Heights of the shape on a grid; NaN everywhere where there is no shape."""
    if not workspace.has_shape():
        return lambda grid: np.full(grid.shape, np.nan)
    caster = RayCaster(workspace.shape())
    return lambda grid: shape_heights(caster, grid, reach=grid.radius)


class _Tally:
    """Counts what the fused maplets rest on while they pass by."""

    def __init__(self) -> None:
        self.sources = dict.fromkeys(Source, 0)
        self.sigma: list[float] = []
        self.untied: list[str] = []
        self.misfits: dict[str, float] = {}
        self.downweighted = self.not_converged = 0

    def passed(self, results: Iterable[FuseResult]) -> Iterator[FusedMaplet]:
        """Yield the maplets."""
        for result in results:
            maplet = result.maplet
            for source in Source:
                self.sources[source] += int(np.count_nonzero(maplet.source == source))
            if maplet.valid.any():
                self.sigma.append(float(np.nanmedian(maplet.sigma)))
            self.untied += [maplet.name] * result.untied
            self.misfits[maplet.name] = result.misfit
            self.downweighted += result.downweighted
            self.not_converged += not result.solution.converged
            yield maplet

    def verdict(self) -> Verdict:
        """Judge whether the lidar contradicts the heights of maplets."""
        worst = sorted(
            ((misfit, name) for name, misfit in self.misfits.items() if misfit > _CONTRADICTS),
            reverse=True,
        )
        if not worst:
            return Verdict()
        compared = sum(np.isfinite(misfit) for misfit in self.misfits.values())
        most = Severity.REFUSED if len(worst) > 0.5 * compared else Severity.DOUBTFUL
        named = ", ".join(f"{name} ({misfit:.1f} times)" for misfit, name in worst[:_NAMED])
        rest = f" and {len(worst) - _NAMED} more" if len(worst) > _NAMED else ""
        text = (
            f"in {len(worst)} of {compared} maplets the lidar contradicts the SPC heights by more "
            f"than {_CONTRADICTS:g} times what it does elsewhere: {named}{rest}"
        )
        return Verdict((Finding(Code.MAPLET_CONTRADICTED, most, text, worst[0][0], _CONTRADICTS),))

    def summary(self, information: SlopeInformation) -> dict[str, Any]:
        """Return what the command prints."""
        total, shape, nan = max(sum(self.sources.values()), 1), information.shape, float("nan")
        return {
            "maplets": len(self.sigma),
            **{f"share_{s.name.lower()}": n / total for s, n in self.sources.items()},
            "median_sigma_m": float(np.median(self.sigma)) if self.sigma else nan,
            "parts_without_lidar": len(self.untied),
            "maplets_with_parts_without_lidar": sorted(set(self.untied)),
            "downweighted_heights": self.downweighted,
            "not_converged": self.not_converged,
            "spc_step_sigma_m": information.step_sigma_m,
            "spc_steep_sigma": information.steep_sigma,
            "spc_bend_sigma": information.bend_sigma,
            "spc_height_sigma_m": information.height_sigma_m,
            "spc_correlated_cells": information.correlated_cells,
            "shape_height_sigma_m": nan if shape is None else shape.height_sigma_m,
            "shape_step_sigma_m": nan if shape is None else shape.step_sigma_m,
        }
