"""Bigmap: fused or solved maplets, all maplets, and returns over larger squares, in one frame."""

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
from fusion.stages.made_maplets import MadeMaplets
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
from spcola.shape import RayCaster, shape_heights


class BigmapStage(Stage):
    """Fused maplets, maplets, scans → bigmaps of each site in one frame.

    ``bigmaps/SITE.MAP`` is made of the fused maplets, or without any of those that were solved from
    images, ``bigmaps/maplets/SITE.MAP`` of all maplets of the solution, and
    ``bigmaps/returns/SITE.MAP`` of the returns if they are registered; each has a sigma companion.
    """

    name = "bigmap"
    version = 5
    needs = ("fuse",)
    places = ("bigmaps",)
    tables = (BigmapSettings, BodySettings, MapolaSettings, SpiceSettings, SpinSettings)

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why no bigmap can be made; empty if it can."""
        if missing := MadeMaplets.of(workspace).missing:
            return missing
        if not workspace.has_shape():
            return "there is no shape in SHAPEFILES to place a bigmap on"
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return fused or solved maplets, maplets, shape, and registered returns."""
        registered = workspace.registration_path
        returns = [*return_paths(workspace, settings), registered] if registered.is_file() else []
        paths = [*MadeMaplets.of(workspace).paths, *workspace.maplet_files(), *returns]
        return [*dict.fromkeys(paths), workspace.shape_path()]

    def run(self, context: StageContext) -> StageResult:
        """Make the two or three bigmaps of every site.

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
        registered = _registered(context) if workspace.registration_path.is_file() else None
        builder = _Builder(workspace, registered, table, RayCaster(shape), radius)
        for folder in ("bigmaps", "bigmaps/maplets", "bigmaps/returns"):
            make_folder(workspace.home / folder)
        sites = {site.name: site for site in table.sites}
        places = {site.name: builder.grid(site).center for site in table.sites}
        chosen = context.chosen(sites, places).values()
        made = context.map("bigmaps", builder.write_site, chosen)
        return StageResult(
            tuple(path for paths, _ in made for path in paths),
            {"bigmaps": len(made), "sites": [summary for _, summary in made]},
            () if registered is not None or not made else (_NOT_REGISTERED,),
        )


STAGE = BigmapStage()

_NOT_REGISTERED = "the lidar is not registered: there are no bigmaps of returns"


def _registered(context: StageContext) -> ScanStore:
    """Return the geolocated returns."""
    return located_store(
        context.workspace,
        context.table(MapolaSettings),
        context.table(SpinSettings),
        context.table(SpiceSettings),
    )


class _Builder:
    """Makes the bigmaps of one site at a time."""

    def __init__(
        self,
        workspace: Workspace,
        store: ScanStore | None,
        table: BigmapSettings,
        caster: RayCaster,
        radius: float,
    ) -> None:
        self._workspace, self._table = workspace, table
        self._caster, self._radius = caster, radius
        self._store = store
        self._maplets = {name: workspace.maplet(name).grid for name in workspace.maplet_names()}
        self._made = MadeMaplets.of(workspace)
        self._grids = self._made.grids()

    def write_site(self, site: BigmapSite) -> tuple[list[Path], dict[str, Any]]:
        """Make and write the bigmaps of `site`; return the files and a summary."""
        grid = self.grid(site)
        spc = (self._workspace.maplet(name) for name in _over(grid, self._maplets))
        made = (self._made.read(name) for name in _over(grid, self._grids))
        root = self._workspace.home / "bigmaps"
        bigmaps = {
            self._made.kind: (root, self._joined(site.name, grid, made)),
            "maplets": (root / "maplets", self._joined(site.name, grid, spc)),
        }
        if self._store is not None:
            gridded = self._gridded(site.name, grid, self._store)
            bigmaps["returns"] = (root / "returns", gridded)
        files = list[Path]()
        summary = {"name": site.name, "gsd_m": grid.gsd, "size": grid.size}
        for kind, (folder, bigmap) in bigmaps.items():
            path = folder / f"{site.name}.MAP"
            write_maplet(path, bigmap, sigma_companion=True)
            files += [path, path.with_suffix(".SIG")]
            summary[f"coverage_{kind}"] = float(np.mean(bigmap.valid))
        return files, summary

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
        gsd = site.gsd_m or float(np.median([grid.gsd for grid in self._grids.values()]))
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

    def _gridded(self, name: str, grid: MapletGrid, store: ScanStore) -> Maplet:
        """Return the bigmap of all registered returns over the grid."""
        registration = self._workspace.registration_path
        content = self._workspace.read_json(registration.name)
        transform = transform_of(content, str(registration))
        options = LidarBigmapOptions(max_gap=self._table.max_gap)
        there = options.gridding.box(grid).mapped(transform.inverse().apply)
        inside = store.returns_inside(there)
        points = transform.apply(inside.points)
        registered = Returns(points, inside.sigma, inside.scan, inside.scan_names)
        return bigmap_from_returns(name, grid, registered, options=options)


def _over(grid: MapletGrid, grids: dict[str, MapletGrid]) -> list[str]:
    """Return the names of the grids that may overlap `grid`."""
    return [name for name, other in grids.items() if overlaps(grid, other)]
