"""Mapolas: the returns of all scans, gridded at the maplets or over the whole body."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion.pipeline import Stage, StageContext, StageResult, with_kept
from fusion.runtime.machine import check_grid
from fusion.scene.geolocation import ReturnSource, advice_on_unplaced, return_paths
from fusion.stages.line_scans import line_scans_not_used, no_images
from fusion.stages.mapolas.adjusting import adjusted, adjustment_summary
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.inputs import BodySettings, SpiceSettings, SpinSettings
from fusion.workspace.settings.processing import MapolaSettings
from lidar.formats.mapolas import write_adjustment, write_mapolas
from lidar.gridding import Gridding, Mapola, grid_returns
from lidar.scan_store import ScanStore
from spcola.errors import SettingsError, WorkspaceError
from spcola.grids import MapletGrid
from spcola.shape import covering

COVER_HALF_SIZE = 49
"""Default q of a covering: 99 × 99 points, as is usual for maplets."""

# Mapolas are small and take up to a second: many may wait behind a long one.
_AHEAD = 64
# A point of a grid takes as long as so many returns: measured on grids of 99 × 99 with 65,000.
_POINT_RETURNS = 4.0


class MapolasStage(Stage):
    """Scans → mapolas."""

    name = "mapolas"
    version = 15
    needs = ("ingest",)
    places = ("mapolas",)
    tables = (MapolaSettings, BodySettings, SpinSettings, SpiceSettings)

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why mapolas cannot be made; empty if they can."""
        if not workspace.scan_names():
            return f"there are no scans; run: spcola import {workspace.root} FILE"
        if settings.mapolas.source == "maplets" and not workspace.maplet_names():
            return 'there are no maplets in MAPFILES; set [mapolas] source = "cover"'
        if settings.mapolas.trajectory == "spc" and (lacking := no_images(workspace)):
            return f'{lacking}; set [mapolas] trajectory = "reference"'
        if settings.mapolas.source == "cover" and not workspace.has_shape():
            return "a covering needs a shape in SHAPEFILES"
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return scans, maplets or the shape, and images or kernels that geolocate returns."""
        paths = return_paths(workspace, settings)
        if settings.mapolas.source == "cover":
            return [*paths, workspace.shape_path()]
        return [*paths, *workspace.maplet_files()]

    def run(self, context: StageContext) -> StageResult:
        """Grid every mapola from the returns around it.

        Raises
        ------
        WorkspaceError
            If no mapola has enough returns.
        """
        workspace, table = context.workspace, context.table(MapolaSettings)
        grids = mapola_grids(workspace, context.settings)
        source = ReturnSource.of(context)
        store = source.store
        adjustment = adjusted(context, source, grids) if table.adjust else None
        source = replace(source, adjustment=adjustment)
        counts, items = _Counts(), context.items

        def one(item: tuple[str, MapletGrid]) -> Gridding:
            name, grid = item
            # Numbered among all scans, the same returns would make another item with each new scan.
            around = source.around(grid).of_own_scans()
            # Workers of a cluster get what the function refers to: not the whole context.
            return items.result(grid_returns, name, grid, around, options=source.options)

        chosen = context.chosen(grids, {name: grid.center for name, grid in grids.items()})
        sizes = [_work(store.count_inside(source.options.box(g)), g) for g in chosen.values()]
        done = context.stream("mapolas", one, chosen.items(), sizes=sizes, ahead=_AHEAD)
        empty = WorkspaceError(
            f"none of {len(grids)} grids is covered to {table.min_coverage:.0%} by returns",
            workspace.home / "mapolas",
            _advice(context, store),
        )
        there = set(workspace.mapola_names())
        made = with_kept(
            grids, chosen, _some(counts.passed(done, table), empty),
            lambda name: workspace.mapola(name) if name in there else None,
        )  # fmt: skip
        write_mapolas(workspace.home / "mapolas", made)
        summary = counts.summary(len(chosen))
        lost = {scan: count for scan, count in store.without_place.items() if count}
        if lost:
            summary["returns_without_place"] = lost
        if context.table(SpiceSettings).kernels or table.trajectory == "spc":
            summary["located_within_m"] = store.interpolation_error_m
        if table.trajectory == "spc":
            summary |= line_scans_not_used(workspace)
        workspace.adjustment_path.unlink(missing_ok=True)
        if adjustment is not None:
            write_adjustment(workspace.adjustment_path, adjustment)
            summary |= adjustment_summary(adjustment)
        return StageResult(tuple(workspace.mapola_paths()), summary)


STAGE = MapolasStage()


def _work(returns: int, grid: MapletGrid) -> float:
    """Return the work of a grid, in returns; none where there are no returns."""
    return returns + _POINT_RETURNS * grid.size**2 if returns else 0.0


def _advice(context: StageContext, store: ScanStore) -> str:
    """Return what to do if no mapola has enough returns."""
    lost = sum(store.without_place.values())
    if lost > len(store) / 2:
        return advice_on_unplaced(context, lost, len(store))
    return (
        "check that scans and maplets have the same frame and unit, or lower [mapolas] min_coverage"
    )


def _some(mapolas: Iterator[Mapola], empty: WorkspaceError) -> Iterator[Mapola]:
    """Yield the mapolas; without any, raise before those of an earlier run are replaced."""
    first = next(mapolas, None)
    if first is None:
        raise empty
    yield first
    yield from mapolas


def mapola_grids(workspace: Workspace, settings: Settings) -> dict[str, MapletGrid]:
    """Return the grids of the mapolas by name: those of the maplets, or a covering.

    Raises
    ------
    SettingsError
        If there is no ground sample distance for a covering.
    """
    table = settings.mapolas
    where = f"{workspace.root / SETTINGS_FILE}: [mapolas]"
    if table.half_size:
        check_grid(table.half_size, where, "lower half_size")
    if table.source == "maplets":
        names = workspace.maplet_names()
        return {name: _adapted(workspace.maplet(name).grid, table) for name in names}
    if not table.gsd_m:
        raise SettingsError("must be given for a covering", f"{where} gsd_m", "in metres")
    half_size = table.half_size or COVER_HALF_SIZE
    shape = workspace.shape()
    # A covering has about as many points as a square of the body's circumference at its GSD.
    check_grid(np.pi * shape.mean_radius / table.gsd_m, where, "raise gsd_m")
    grids = covering(shape, table.gsd_m, half_size, overlap=table.overlap)
    # SPC allows names of six characters.
    return {f"C{number:05d}": grid for number, grid in enumerate(grids, start=1)}


def _adapted(grid: MapletGrid, table: MapolaSettings) -> MapletGrid:
    """Return `grid` at the ground sample distance and half-size of the settings."""
    if table.gsd_m:
        grid = grid.with_gsd(table.gsd_m)
    return replace(grid, half_size=table.half_size) if table.half_size else grid


@dataclass
class _Counts:
    """Counts used and rejected returns, and mapolas."""

    made: int = 0
    used: int = 0
    rejected: int = 0
    not_settled: int = 0
    coverage: float = 0.0

    def passed(self, done: Iterator[Gridding], table: MapolaSettings) -> Iterator[Mapola]:
        """Yield the mapolas with enough coverage, without cells of too few returns."""
        for gridding in done:
            mapola, report = gridding.mapola, gridding.report
            if table.min_count > 1:
                thin = mapola.count < table.min_count
                mapola = mapola.with_layers(
                    height=np.where(thin, np.nan, mapola.height),
                    sigma=np.where(thin, np.nan, mapola.sigma),
                )
            if not mapola.valid.any() or mapola.coverage < table.min_coverage:
                continue
            self.made += 1
            self.used += report.used
            self.rejected += report.isolated + report.outlying
            self.not_settled += not report.converged
            self.coverage += mapola.coverage
            yield mapola

    def summary(self, grids: int) -> dict[str, Any]:
        """Return what the command prints."""
        return {
            "grids": grids,
            "mapolas": self.made,
            "returns_used": self.used,
            "returns_rejected": self.rejected,
            "mean_coverage": self.coverage / self.made,
            "not_settled": self.not_settled,
        }
