"""Register: mapolas are matched to the SPC surface, and one transform is fitted to all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion.fusing.constraints import overlaps
from fusion.memory import check_grid
from fusion.registration.fit import FitOptions
from fusion.registration.kinds import fit_mapolas, kinds_json, register_kinds
from fusion.registration.landmarks import LandmarkErrors
from fusion.registration.match import Match, MatchOptions, Surface, match_surfaces
from fusion.registration.noise import NoiseSpectrum, estimate_spectrum
from fusion.registration.resolution import estimate_blur
from fusion.registration.scans import ScanEffects, share_matrix
from fusion.registration.summary import MatchedMapolas, registration_json
from fusion.settings import Settings
from fusion.stages.base import StageContext, StageResult
from fusion.stages.imaging import imaged_mapolas, landmark_files
from fusion.tables import BodySettings, RegisterSettings, Table
from fusion.workspace import SETTINGS_FILE, Workspace
from spcola.bigmap import BigmapOptions, make_bigmap
from spcola.errors import NotObservableError
from spcola.maplet import Maplet, MapletGrid
from spcola.network import NetworkOptions, solve_network
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
    tables: tuple[type[Table], ...] = (RegisterSettings, BodySettings)

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why there is nothing to register."""
        if not workspace.mapola_names():
            return f"there are no mapolas; run: spcola mapolas {workspace.root}"
        if settings.registration.against == "shape" and not workspace.has_shape():
            return "there is no shape in SHAPEFILES to register against"
        if settings.registration.against != "shape" and not workspace.maplet_names():
            return 'there are no maplets in MAPFILES; set [register] against = "shape"'
        if settings.registration.by != "topography" and not workspace.image_names():
            return 'there are no images in SUMFILES; set [register] by = "topography"'
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return the mapolas, the maplets or the shape, and what images are looked at with."""
        shape = settings.registration.against == "shape"
        surface = [workspace.shape_path()] if shape else workspace.maplet_files()
        seen: list[Path] = []
        if settings.registration.by == "topography":
            if settings.registration.landmarks != "ignore" and not shape:
                sums = [workspace.image_path(name) for name in workspace.image_names()]
                seen = [*sums, *landmark_files(workspace)]
        else:
            seen = [*workspace.image_files(), *landmark_files(workspace)]
            if workspace.has_shape() and not shape:
                seen.append(workspace.shape_path())
        return [*workspace.mapola_paths(), *surface, *seen]

    def run(self, context: StageContext) -> StageResult:
        """Learn from a sample how SPC smooths and errs, match every mapola, fit.

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

        def matched(name: str, blur: float, spectrum: NoiseSpectrum | None = None) -> Match:
            mapola = workspace.mapola(name)
            check_grid(
                mapola.grid.half_size + table.capture_m / mapola.grid.gsd,
                f"{workspace.root / SETTINGS_FILE}: [register] capture_m",
                "lower it",
            )
            return match_surfaces(
                name,
                mapola.grid,
                Surface(mapola.height, mapola.sigma),
                reference(name, mapola.grid),
                blur_cells=blur,
                spectrum=spectrum,
                options=options,
            )

        def measured(name: str) -> float:
            return _blur(matched(name, 0.0), reference, workspace.mapola(name).grid)

        blurs = np.array(context.map("compare resolutions", measured, _sample(names)))
        blur = float(np.nanmedian(blurs)) if np.isfinite(blurs).any() else 0.0
        first = context.map("compare errors", lambda name: matched(name, blur), _sample(names))
        spectrum = estimate_spectrum(match.residual for match in first if match.usable)
        matches = context.map("match mapolas", lambda name: matched(name, blur, spectrum), names)
        mapolas = _with_scans(workspace, matches, table)
        if table.by == "topography":
            mapolas = replace(mapolas, landmarks=_landmarks(context, names))
            content = self._by_topography(context, mapolas)
        else:
            grids = [workspace.mapola(name).grid for name in names]
            imaged = imaged_mapolas(context, names, grids)
            found = register_kinds(table.by, grids, mapolas, imaged, options=_fit_options(table))
            content = kinds_json(table.by, found, matches, imaged)
        content["blur_cells"] = blur
        content["noise_spectrum"] = None if spectrum is None else spectrum.as_json()
        path = context.write_json(workspace.registration_path.name, content)
        summary = {k: v for k, v in content.items() if k not in _LONG}
        return StageResult((path,), summary)

    def _by_topography(self, context: StageContext, mapolas: MatchedMapolas) -> dict[str, Any]:
        """Fit the transform to the matches of heights."""
        if not mapolas.usable.any():
            raise NotObservableError(
                f"none of {len(mapolas.matches)} mapolas matches the SPC surface "
                f"({mapolas.matches[0].reason})",
                where=context.workspace.root / "mapolas",
                do="check that lidar and SPC are of one body and one frame, or raise [register] "
                "capture_m",
            )
        options = _fit_options(context.table(RegisterSettings))
        content = registration_json(fit_mapolas(mapolas, options=options), mapolas)
        return {**content, "by": "topography"}


STAGE = RegisterStage()


def _landmarks(context: StageContext, names: list[str]) -> LandmarkErrors | None:
    """How the maplets err, by their landmarks' sigmas and the images; None if not to be asked."""
    workspace, table = context.workspace, context.table(RegisterSettings)
    if table.landmarks == "ignore" or table.against == "shape" or not workspace.landmark_names():
        return None
    landmarks = [workspace.landmark(name) for name in workspace.landmark_names()]
    network = solve_network(
        [landmark.name for landmark in landmarks],
        np.array([landmark.grid.center for landmark in landmarks]),
        np.array([landmark.sigma for landmark in landmarks]),
        workspace.images() if table.landmarks == "images" else [],
        options=NetworkOptions(center_sigma=table.center_sigma_m),
    )
    return LandmarkErrors.of_mapolas(network, names, table.center_sigma_m)


def _fit_options(table: RegisterSettings) -> FitOptions:
    """How the transform is fitted by the settings."""
    return FitOptions(
        model=table.model, center_sigma_m=table.center_sigma_m, reject=table.reject_sigmas
    )


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


_LONG = frozenset({"per_mapola", "per_scan", "covariance", "parameters", "noise_spectrum"})

# Blur and spectrum are of the whole solution; this many mapolas tell them.
_SAMPLE = 24


def _sample(names: list[str]) -> list[str]:
    """At most that many names, spread over the list, the same in each run."""
    return names[:: -(-len(names) // _SAMPLE)]


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
