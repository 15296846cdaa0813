"""Register: mapolas are matched to the SPC surface, and one transform is fitted to all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fusion.fusing.constraints import overlaps
from fusion.locating import return_paths
from fusion.memory import check_grid
from fusion.registration.fit import FitOptions, fit_transform
from fusion.registration.match import Match, MatchOptions, Surface, match_surfaces
from fusion.registration.resolution import estimate_blur
from fusion.registration.scans import ScanEffects, share_matrix
from fusion.registration.summary import MatchedMapolas, registration_json
from fusion.return_source import ReturnSource
from fusion.scan_fits import ScanRegistration
from fusion.settings import Settings
from fusion.stages.base import StageContext, StageResult
from fusion.tables import (
    BodySettings,
    MapolaSettings,
    RegisterSettings,
    SpiceSettings,
    SpinSettings,
    Table,
)
from fusion.workspace import SETTINGS_FILE, Workspace
from spcola.bigmap import BigmapOptions, make_bigmap
from spcola.errors import NotObservableError
from spcola.maplet import Maplet, MapletGrid
from spcola.rays import RayCaster
from spcola.regrid import project_maplet
from spcola.shapegrid import shape_heights

Reference = Callable[[str, MapletGrid], Surface]
"""The SPC surface on a grid, for the mapola of a name."""


@dataclass(frozen=True)
class RegisterStage:
    """Mapolas and SPC surface → registration.json."""

    name: str = "register"
    version: int = 7
    tables: tuple[type[Table], ...] = (
        RegisterSettings,
        BodySettings,
        MapolaSettings,
        SpinSettings,
        SpiceSettings,
    )

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why there is nothing to register."""
        if not workspace.mapola_names():
            return f"there are no mapolas; run: spcola mapolas {workspace.root}"
        if settings.registration.against == "shape" and not workspace.has_shape():
            return "there is no shape in SHAPEFILES to register against"
        if settings.registration.against != "shape" and not workspace.maplet_names():
            return 'there are no maplets in MAPFILES; set [register] against = "shape"'
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return the mapolas, the maplets or the shape, and the returns where these are asked."""
        paths = workspace.mapola_paths()
        if settings.registration.by == "returns":
            paths = [*paths, *return_paths(workspace, settings)]
        if settings.registration.against == "shape":
            return [*paths, workspace.shape_path()]
        return [*paths, *workspace.maplet_files()]

    def run(self, context: StageContext) -> StageResult:
        """Match every mapola, bring both surfaces to one resolution, match again, fit.

        Raises
        ------
        NotObservableError
            If too few mapolas match, or a parameter of the model is free.
        """
        workspace, table = context.workspace, context.table(RegisterSettings)
        reference = surface_reference(workspace, table.against)
        options = MatchOptions(
            capture_m=table.capture_m,
            min_coverage=table.min_coverage,
            min_correlation=table.min_correlation,
        )
        names = workspace.mapola_names()
        source = ReturnSource.of(context) if table.by == "returns" else None

        def matched(name: str, blur: float) -> Match:
            mapola = workspace.mapola(name)
            check_grid(
                mapola.grid.half_size + table.capture_m / mapola.grid.gsd,
                f"{workspace.root / SETTINGS_FILE}: [register] capture_m",
                "lower it",
            )
            if source is not None:
                spc = reference(name, mapola.grid)
                return source.match(name, mapola.grid, spc, blur, options)
            return match_surfaces(
                name,
                mapola.grid,
                Surface(mapola.height, mapola.sigma),
                reference(name, mapola.grid),
                blur_cells=blur,
                options=options,
            )

        def measured(name: str) -> float:
            return _blur(matched(name, 0.0), reference, workspace.mapola(name).grid)

        blurs = np.array(context.map("compare resolutions", measured, _sample(names)))
        blur = float(np.nanmedian(blurs)) if np.isfinite(blurs).any() else 0.0
        matches = context.map("match mapolas", lambda name: matched(name, blur), names)
        usable = [match for match in matches if match.usable]
        if not usable:
            raise NotObservableError(
                f"none of {len(names)} mapolas matches the SPC surface ({matches[0].reason})",
                where=workspace.root / "mapolas",
                do="check that lidar and SPC are of one body and one frame, or raise [register] "
                "capture_m",
            )
        mapolas = _with_scans(workspace, matches, table)
        registration = fit_transform(
            np.stack([match.center for match in usable]),
            np.stack([match.displacement for match in usable]),
            np.stack([match.covariance for match in usable]) + mapolas.beside[mapolas.usable],
            mapolas.effects[mapolas.usable],
            options=FitOptions(
                model=table.model,
                center_sigma_m=table.center_sigma_m,
                reject=table.reject_sigmas,
            ),
        )
        content = registration_json(registration, mapolas, blur_cells=blur)
        if source is not None:
            grids = {name: workspace.mapola(name).grid for name in names}
            scans = ScanRegistration(source, reference, registration, blur)
            content["per_scan_fit"] = scans.entries(context, grids)
        path = context.write_json(workspace.registration_path.name, content)
        summary = {k: v for k, v in content.items() if k not in _LONG}
        return StageResult((path,), summary)


STAGE = RegisterStage()


def _with_scans(
    workspace: Workspace, matches: list[Match], table: RegisterSettings
) -> MatchedMapolas:
    """How scan errors reach the mapolas: what their adjustment left, or errors of each scan."""
    found = [workspace.mapola(match.name).scan_share for match in matches]
    centers = np.array([match.center for match in matches])
    adjustment = workspace.adjustment()
    if adjustment is None:
        names = sorted({name for share in found for name in share})
        shares = share_matrix(found, names)
        scans = ScanEffects.independent(names, table.scan_sigma_m)
    else:
        shares = share_matrix(found, adjustment.names)
        scans = ScanEffects.left_by(adjustment, shares, centers)
    return MatchedMapolas(matches, scans, scans.at(shares, centers), scans.beside(shares, centers))


_LONG = frozenset({"per_mapola", "per_scan", "per_scan_fit", "covariance", "parameters"})

# The blur is one number for the whole solution; this many mapolas tell it.
_BLUR_SAMPLE = 24


def _sample(names: list[str]) -> list[str]:
    """At most that many names, spread over the list, the same in each run."""
    return names[:: -(-len(names) // _BLUR_SAMPLE)]


def _blur(match: Match, reference: Reference, grid: MapletGrid) -> float:
    """Blur of the SPC surface against the lidar, cells; NaN where the match is not usable."""
    if not match.usable:
        return float("nan")
    spc = reference(match.name, grid).height
    return estimate_blur(spc - match.residual, spc)


def surface_reference(workspace: Workspace, against: str) -> Reference:
    """The SPC surface on any grid: the maplet itself, a bigmap, or the shape.

    Parameters
    ----------
    workspace : Workspace
    against : {"maplets", "bigmap", "shape"}
        As in [register]; "maplets" falls back to a bigmap where a mapola has no maplet.

    Returns
    -------
    callable
        (name, grid) → heights and sigmas (2q+1, 2q+1), metres along the grid's Uz; NaN where SPC
        has none. A shape states no sigmas.
    """
    if against == "shape":
        caster = RayCaster(workspace.shape())
        return lambda _, grid: Surface(shape_heights(caster, grid, reach=grid.radius))
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
    """Read the maplets that share ground with `grid`."""
    return [workspace.maplet(name) for name, other in grids.items() if overlaps(grid, other)]
