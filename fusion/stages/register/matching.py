"""Match of all mapolas of a workspace with the SPC surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.pipeline import StageContext
from fusion.pipeline.items import ItemStore
from fusion.registration.results import GivenRegistration
from fusion.registration.returns import CloudOfReturns, FixedSurface, match_returns
from fusion.runtime.machine import check_grid
from fusion.scene import Reference, surface_reference
from fusion.scene.geolocation import ReturnSource
from fusion.surfacematch import Match, MatchOptions, Surface, match_surfaces
from fusion.surfacematch.resolution import (
    NoiseSpectrum,
    Transfer,
    estimate_blur,
    estimate_spectrum,
    estimate_transfer,
)
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings.processing import RegisterSettings
from lidar.gridding import Mapola
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError
from spcola.grids import MapletGrid

# Most mapolas from which blur and spectrum of the whole solution are estimated.
_SAMPLE = 24
# Share of a mapola's cells that should have returns for a good match.
_FILLED = 0.8


@dataclass(frozen=True, eq=False)
class Matched:
    """Matches, and what was estimated for them.

    Attributes
    ----------
    matches : list of Match
        Matches of all mapolas, also of those that do not match, in the order of their names.
    blur_cells : float
        Blur of the SPC surface against the lidar, which the match takes into account, cells.
    spectrum : NoiseSpectrum or None
        Spectrum of their differences, by which these were whitened.
    transfer : Transfer or None
        Share of the lidar's relief in SPC by wavelength, without a correction of the blur.
    """

    matches: list[Match]
    blur_cells: float
    spectrum: NoiseSpectrum | None
    transfer: Transfer | None


class Aligned(NamedTuple):
    """Heights (R, C) of lidar and SPC on one grid, metres, and SPC's blur against it, cells."""

    lidar: FloatArray
    spc: FloatArray
    blur: float


@dataclass(frozen=True, eq=False)
class Matcher:
    """Matches mapolas of a workspace, from their own place or as moved by a transform.

    Parameters
    ----------
    workspace : Workspace
    table : RegisterSettings
    reference : callable
    given : GivenRegistration or None
    source : ReturnSource or None
        Source of returns, if they are matched instead of the mapolas' heights.
    items : ItemStore
        Where finished matches are kept.
    """

    workspace: Workspace
    table: RegisterSettings
    reference: Reference
    given: GivenRegistration | None
    source: ReturnSource | None
    items: ItemStore

    @property
    def options(self) -> MatchOptions:
        """Options of the match from the settings."""
        return MatchOptions(
            capture_m=self.table.capture_m,
            min_coverage=self.table.min_coverage,
            min_correlation=self.table.min_correlation,
        )

    def grid(self, grid: MapletGrid) -> MapletGrid:
        """Return the grid from which a mapola is searched."""
        return grid if self.given is None else self.given.moved(grid)

    def match(self, name: str, blur: float, spectrum: NoiseSpectrum | None = None) -> Match:
        """Match one mapola."""
        mapola = self.workspace.mapola(name)
        grid = self.grid(mapola.grid)
        check_grid(
            grid.half_size + self.table.capture_m / grid.gsd,
            f"{self.workspace.root / SETTINGS_FILE}: [register] capture_m",
            "lower it",
        )
        if self.source is not None:
            return self.match_returns(self.source, name, grid, blur)
        return self.items.result(
            match_surfaces,
            name,
            grid,
            Surface(mapola.height, mapola.sigma),
            self.reference(name, grid),
            blur_cells=blur,
            spectrum=spectrum,
            options=self.options,
        )

    def match_returns(
        self, source: ReturnSource, name: str, grid: MapletGrid, blur: float
    ) -> Match:
        """Match the returns around the grid of a mapola."""
        around = source.around(grid, self.options.capture_m)
        fixed = FixedSurface(grid, self.reference(name, grid), blur)
        cloud = CloudOfReturns(around.points, around.sigma)
        return self.items.result(match_returns, name, cloud, fixed, options=self.options)

    def aligned(self, name: str) -> Aligned | None:
        """Return heights of a mapola and SPC, matched without blur; None if they do not match."""
        match = self.match(name, 0.0)
        if not match.usable:
            return None
        mapola = self.workspace.mapola(name)
        reference = self.reference(name, self.grid(mapola.grid))
        lidar, spc = match.on_one_grid(mapola.height, reference.height)
        blur = estimate_blur(lidar, spc, of_slopes=reference.of_slopes)
        return Aligned(lidar, spc, blur)


def match_mapolas(
    context: StageContext,
    given: GivenRegistration | None = None,
    source: ReturnSource | None = None,
) -> Matched:
    """Estimate blur and error spectrum of SPC from a sample, then match all mapolas.

    With a `given` transform mapolas are moved by it; with a `source` the returns are matched.
    Possibly no match is usable.
    """
    workspace, table = context.workspace, context.table(RegisterSettings)
    reference = surface_reference(workspace, table.against)
    matcher = Matcher(workspace, table, reference, given, source, context.items)
    centers = {name: workspace.mapola(name).grid.center for name in workspace.mapola_names()}
    names = list(context.chosen(centers, centers))
    sample = names[:: -(-len(names) // _SAMPLE)]
    aligned = [pair for pair in context.map("compare resolutions", matcher.aligned, sample) if pair]
    blurs = np.array([pair.blur for pair in aligned])
    blur = float(np.nanmedian(blurs)) if np.isfinite(blurs).any() else 0.0
    spectrum = None
    if source is None:
        first = context.map("compare errors", lambda name: matcher.match(name, blur), sample)
        spectrum = estimate_spectrum(match.residual for match in first if match.usable)
    matches = context.map("match mapolas", lambda name: matcher.match(name, blur, spectrum), names)
    transfer = estimate_transfer((pair.lidar, pair.spc) for pair in aligned)
    return Matched(matches, blur, spectrum, transfer)


def check_usable(matches: list[Match], workspace: Workspace, min_coverage: float) -> None:
    """Check that any of the matches is usable.

    Raises
    ------
    NotObservableError
        If none is; with the reason of the one with the largest coverage, and advice.
    """
    if any(match.usable for match in matches):
        return
    best = max(matches, key=lambda match: match.coverage)
    advice = "check that lidar and SPC have the same body and frame, or raise [register] capture_m"
    if best.coverage < min_coverage:
        advice = _advice_on_gaps(workspace.mapola(best.name), best.coverage)
    raise NotObservableError(
        f"none of {len(matches)} mapolas matches the SPC surface ({best.name}: {best.reason})",
        where=workspace.home / "mapolas",
        do=advice,
    )


def _advice_on_gaps(mapola: Mapola, compared: float) -> str:
    """Return what to do if a mapola and SPC share too little of a grid.

    With n random returns per cell on average, a share of 1 − exp(−n) of the cells is filled.
    """
    filled = float(np.mean(mapola.valid))
    if compared < 0.5 * filled:
        return "check that maplets lie where the lidar has returns, in the same frame"
    wanted = mapola.grid.gsd * np.sqrt(np.log(1.0 - _FILLED) / np.log(1.0 - filled))
    return (
        f"{filled:.0%} of its cells have returns; at [mapolas] gsd_m = {wanted:.2g} about "
        f"{_FILLED:.0%} would, or lower [register] min_coverage"
    )
