"""Bigmap: fused maplets, SPC maplets and lidar returns over larger squares, each in one frame."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from fusion.pipeline import Stage, StageContext, StageResult
from fusion.registration.results import transform_of
from fusion.runtime.folders import make_folder
from fusion.runtime.machine import check_grid
from fusion.scene.geolocation import located_store, return_paths
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.inputs import BodySettings, SpiceSettings, SpinSettings
from fusion.workspace.settings.processing import BigmapSettings, BigmapSite, MapolaSettings
from lidar.gridding import LidarBigmapOptions, bigmap_from_returns
from lidar.scan_store import ScanStore
from lidar.scans import Returns
from spcola.bigmap import BigmapOptions, make_bigmap
from spcola.errors import WorkspaceError
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid, overlaps
from spcola.math import Affine
from spcola.shape import RayCaster, shape_heights


class BigmapStage(Stage):
    """Fused maplets, maplets, scans → bigmaps of each site in one frame.

    ``bigmaps/SITE.MAP`` is made of the fused maplets, ``bigmaps/maplets/SITE.MAP`` of the SPC
    maplets, ``bigmaps/returns/SITE.MAP`` of the registered returns; each has a sigma companion.
    """

    name = "bigmap"
    version = 5
    needs = ("fuse",)
    places = ("bigmaps",)
    tables = (BigmapSettings, BodySettings, MapolaSettings, SpiceSettings, SpinSettings)

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why no bigmap can be made; empty if it can."""
        if not workspace.fused_names():
            return f"there are no fused maplets; run: spcola fuse {workspace.root}"
        if not workspace.has_shape():
            return "there is no shape in SHAPEFILES to place a bigmap on"
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return fused maplets, maplets, returns, registration and shape."""
        return [
            *workspace.fused_paths(),
            *workspace.maplet_files(),
            *return_paths(workspace, settings),
            workspace.registration_path,
            workspace.shape_path(),
        ]

    def run(self, context: StageContext) -> StageResult:
        """Make the three bigmaps of every site.

        Raises
        ------
        WorkspaceError
            If two sites have the same name, or no ray meets the shape at a site.
        """
        workspace, table = context.workspace, context.table(BigmapSettings)
        names = [site.name for site in table.sites]
        if len(set(names)) < len(names):
            where = f"{workspace.root / SETTINGS_FILE}: [bigmap] sites"
            raise WorkspaceError("two sites have the same name", where, "rename one")
        shape = workspace.shape()
        radius = context.table(BodySettings).mean_radius_m or shape.mean_radius
        store = located_store(
            workspace,
            context.table(MapolaSettings),
            context.table(SpinSettings),
            context.table(SpiceSettings),
        )
        builder = _Builder(workspace, store, table, RayCaster(shape), radius)
        for folder in ("bigmaps", "bigmaps/maplets", "bigmaps/returns"):
            make_folder(workspace.home / folder)
        sites = {site.name: site for site in table.sites}
        places = {site.name: builder.grid(site).center for site in table.sites}
        chosen = context.chosen(sites, places).values()
        made = context.map("bigmaps", builder.write_site, chosen)
        return StageResult(
            tuple(path for paths, _ in made for path in paths),
            {"bigmaps": len(made), "sites": [summary for _, summary in made]},
        )


STAGE = BigmapStage()


class _Builder:
    """Makes the bigmaps of one site at a time."""

    def __init__(
        self,
        workspace: Workspace,
        store: ScanStore,
        table: BigmapSettings,
        caster: RayCaster,
        radius: float,
    ) -> None:
        self._workspace, self._table = workspace, table
        self._caster, self._radius = caster, radius
        registration = workspace.read_json(workspace.registration_path.name)
        self._transform: Affine = transform_of(registration, str(workspace.registration_path))
        self._store = store
        self._maplets = {name: workspace.maplet(name).grid for name in workspace.maplet_names()}
        self._fused = {name: workspace.fused(name).grid for name in workspace.fused_names()}

    def write_site(self, site: BigmapSite) -> tuple[list[Path], dict[str, Any]]:
        """Make and write the bigmaps of `site`; return the files and a summary."""
        grid = self.grid(site)
        spc = (self._workspace.maplet(name) for name in _over(grid, self._maplets))
        fused = (self._workspace.fused(name) for name in _over(grid, self._fused))
        root = self._workspace.home / "bigmaps"
        bigmaps = {
            root / f"{site.name}.MAP": self._joined(site.name, grid, fused),
            root / "maplets" / f"{site.name}.MAP": self._joined(site.name, grid, spc),
            root / "returns" / f"{site.name}.MAP": self._gridded(site.name, grid),
        }
        files = []
        for path, bigmap in bigmaps.items():
            write_maplet(path, bigmap, sigma_companion=True)
            files += [path, path.with_suffix(".SIG")]
        shares = [float(np.mean(bigmap.valid)) for bigmap in bigmaps.values()]
        keys = ("coverage_fused", "coverage_maplets", "coverage_returns")
        summary = {"name": site.name, "gsd_m": grid.gsd, "size": grid.size}
        return files, {**summary, **dict(zip(keys, shares, strict=True))}

    def grid(self, site: BigmapSite) -> MapletGrid:
        """Return the site's grid, centred where its latitude and longitude meet the shape."""
        latitude, longitude = np.radians([site.latitude_deg, site.longitude_deg])
        away = np.array(
            [
                np.cos(latitude) * np.cos(longitude),
                np.cos(latitude) * np.sin(longitude),
                np.sin(latitude),
            ]
        )
        hits = self._caster.cast(10.0 * self._radius * away[None], -away[None])
        if not hits.hit[0]:
            raise WorkspaceError(
                "no ray towards the centre meets the shape there", f"[bigmap] site {site.name}"
            )
        gsd = site.gsd_m or float(np.median([grid.gsd for grid in self._fused.values()]))
        size = site.size_m or 0.5 * self._radius
        half_size = max(2, round(size / gsd / 2.0))
        check_grid(
            half_size,
            f"{self._workspace.root / SETTINGS_FILE}: [bigmap] site {site.name}",
            f"check its size_m and gsd_m, and the unit of the shape (its radius: {self._radius:g})",
        )
        # The plane is normal to the radius: the normal of a single facet would tilt it.
        return MapletGrid.facing(hits.points[0], away, gsd, half_size)

    def _joined(self, name: str, grid: MapletGrid, maplets: Iterable[Maplet]) -> Maplet:
        """Return the bigmap of maplets."""
        table = self._table
        reference = None
        if table.max_distance_m:
            reference = shape_heights(self._caster, grid, reach=grid.radius)
        options = BigmapOptions(
            max_gsd=table.max_gsd_m or None,
            max_distance=table.max_distance_m or None,
            constraint_fraction=table.constraint_fraction,
            seed=table.seed,
        )
        return make_bigmap(name, grid, maplets, options=options, reference=reference)

    def _gridded(self, name: str, grid: MapletGrid) -> Maplet:
        """Return the bigmap of all registered returns over the grid."""
        options = LidarBigmapOptions(max_gap=self._table.max_gap)
        there = options.gridding.box(grid).mapped(self._transform.inverse().apply)
        inside = self._store.returns_inside(there)
        points = self._transform.apply(inside.points)
        registered = Returns(points, inside.sigma, inside.scan, inside.scan_names)
        return bigmap_from_returns(name, grid, registered, options=options)


def _over(grid: MapletGrid, grids: dict[str, MapletGrid]) -> list[str]:
    """Return the names of the grids that may overlap `grid`."""
    return [name for name, other in grids.items() if overlaps(grid, other)]
