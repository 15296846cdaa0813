"""All mapolas of a workspace matched with the SPC surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.pipeline import StageContext
from fusion.registration.results import GivenRegistration
from fusion.runtime.machine import check_grid
from fusion.scene import Reference, surface_reference
from fusion.stages.register.return_source import ReturnSource
from fusion.surfacematch import (
    Match,
    MatchOptions,
    Surface,
    match_surfaces,
)
from fusion.surfacematch.resolution import (
    NoiseSpectrum,
    Transfer,
    estimate_blur,
    estimate_spectrum,
    estimate_transfer,
)
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings import RegisterSettings
from lidar.gridding import Mapola
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError
from spcola.grids import MapletGrid

# Blur and spectrum are of the whole solution; this many mapolas tell them.
_SAMPLE = 24
# Share of a mapola's cells that are to have returns for a good match.
_FILLED = 0.8


@dataclass(frozen=True, eq=False)
class Matched:
    """What was found.

    Attributes
    ----------
    matches : list of Match
        Of all mapolas, those that do not match too, in the order of their names.
    blur_cells : float
        Blur of the SPC surface against the lidar that was made good, cells.
    spectrum : NoiseSpectrum or None
        Of their differences, by which they were made white.
    transfer : Transfer or None
        What SPC keeps of the lidar's relief, wavelength by wavelength, before the blur was made
        good.
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
    """Matches mapolas of a workspace where a transform puts them, or where they are.

    Parameters
    ----------
    workspace : Workspace
    table : RegisterSettings
    reference : callable
    given : GivenRegistration or None
    source : ReturnSource or None
        Of returns that are matched themselves, instead of the mapolas' heights.
    """

    workspace: Workspace
    table: RegisterSettings
    reference: Reference
    given: GivenRegistration | None
    source: ReturnSource | None

    @property
    def options(self) -> MatchOptions:
        """How surfaces are matched, by the settings."""
        return MatchOptions(
            capture_m=self.table.capture_m,
            min_coverage=self.table.min_coverage,
            min_correlation=self.table.min_correlation,
        )

    def grid(self, grid: MapletGrid) -> MapletGrid:
        """Return where a mapola's grid is searched from."""
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
            return self.source.match(name, grid, self.reference(name, grid), blur, self.options)
        return match_surfaces(
            name,
            grid,
            Surface(mapola.height, mapola.sigma),
            self.reference(name, grid),
            blur_cells=blur,
            spectrum=spectrum,
            options=self.options,
        )

    def aligned(self, name: str) -> Aligned | None:
        """Heights of a mapola and of SPC where they match as they are; None where they do not."""
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
    """Learn from a sample how SPC smooths and how it errs, then match all mapolas.

    Where a transform is `given` they are matched as it puts them; with a `source` of returns, by
    these. None may be usable.
    """
    workspace, table = context.workspace, context.table(RegisterSettings)
    matcher = Matcher(workspace, table, surface_reference(workspace, table.against), given, source)
    names = workspace.mapola_names()
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
        If none is; with the reason of the one that compared most, and what would help.
    """
    if any(match.usable for match in matches):
        return
    best = max(matches, key=lambda match: match.coverage)
    advice = "check that lidar and SPC are of one body and one frame, or raise [register] capture_m"
    if best.coverage < min_coverage:
        advice = _advice_on_gaps(workspace.mapola(best.name), best.coverage)
    raise NotObservableError(
        f"none of {len(matches)} mapolas matches the SPC surface ({best.name}: {best.reason})",
        where=workspace.root / "mapolas",
        do=advice,
    )


def _advice_on_gaps(mapola: Mapola, compared: float) -> str:
    """What to do where a mapola and SPC share too little of a grid.

    Of returns that fall at random, n in a cell in the mean, a share of 1 − exp(−n) is filled.
    """
    filled = float(np.mean(mapola.valid))
    if compared < 0.5 * filled:
        return "check that maplets lie where the lidar has returns, and that the frames are one"
    wanted = mapola.grid.gsd * np.sqrt(np.log(1.0 - _FILLED) / np.log(1.0 - filled))
    return (
        f"{filled:.0%} of its cells have returns; at [mapolas] gsd_m = {wanted:.2g} about "
        f"{_FILLED:.0%} would, or lower [register] min_coverage"
    )
