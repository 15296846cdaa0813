"""Test whether single shots fit the shape at their stated positions, or better elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress

import numpy as np

from fusion.runtime.machine import one_blas_thread
from fusion.scaling.fit.observation import TrajectorySource
from fusion.scaling.geometry.placement import LidarPlacement
from fusion.scaling.misplacement.fit import PlaceFit, clipped, scatter
from fusion.scaling.misplacement.places import Place, Z, trial_places
from fusion.scaling.misplacement.significance import (
    FEWEST_INDEPENDENT,
    FEWEST_SHOTS,
    LARGER,
    chance_of_fit,
    chance_of_larger,
    independent,
)
from fusion.scaling.shots.shots import compare_shots
from lidar.scans import Scan
from spcola.arrays import FloatArray
from spcola.shape import RayCaster

# Number of shots compared at each place: more would hardly improve the test.
_SAMPLE = 400
# Rays cast at once.
_RAYS = 100_000
# The best place is refined with these steps; its fit has no rotation.
_FINER_DEG = (1.0, 0.5, 0.25)
_LOOSE = np.array([0.0, 0.0, 0.0, 0.0, *np.radians([2.0, 2.0, 2.0]), 0.0])
_FIRM = np.array([1.0, 1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3, 1.0])
_CLAIMED = LidarPlacement()
FALSE_ALARM = 1e-3
"""Probability over all places that correct shots seem to fit better elsewhere.

It is exact for white errors. For errors as large as the relief that are correlated along a short
track it is somewhat larger (docs: truth, "Wrong input").
"""


@dataclass(frozen=True, eq=False)
class PlaceCheck:
    """Fit of the shots at their stated positions, and elsewhere.

    The scatter is that of range residuals after a fit of the eight parameters of the estimate
    within their priors, so that a wrong radius is not mistaken for a wrong longitude.

    Attributes
    ----------
    count : int
        Shots compared.
    here_m, best_m : float
        Scatter at the stated positions and at the best other place, metres; NaN if less than half
        of the shots hit the shape, or fewer than ten.
    best : Place
    paired : float
        p-value, over all places tried, of the scatter here exceeding that at the best other place
        (:func:`fusion.scaling.misplacement.significance.chance_of_larger`, Bonferroni's bound).
    tried : int
        Number of places.
    usual_m : float
        Median scatter at the wrong places: rotated by more than 20°, or mirrored.
    wrong, as_good : int
        Number of these, and number of these at which the shots fit as well as here.
    noise : float
        p-value for errors that are correlated as the residuals are (:func:`chance_of_fit`); 0, not
        computed, where `paired` is not below :data:`FALSE_ALARM`.
    independent : float
        Effective number of independent shots, from the residuals at the best other place.
    """

    count: int = 0
    here_m: float = float("nan")
    best_m: float = float("nan")
    best: Place = field(default_factory=lambda: Place(Z, 0.0))
    paired: float = 1.0
    tried: int = 0
    usual_m: float = float("nan")
    wrong: int = 0
    as_good: int = 0
    noise: float = 0.0
    independent: float = 0.0

    @property
    def p_value(self) -> float:
        """The larger of both p-values."""
        return max(self.paired, self.noise)

    @property
    def misfit(self) -> bool:
        """Whether the shots fit significantly better elsewhere."""
        known = self.independent >= FEWEST_INDEPENDENT
        return known and self.p_value < FALSE_ALARM and not self.here_m <= LARGER * self.best_m

    @property
    def by_chance(self) -> bool:
        """Whether the fit may be due to chance: it is as good at a wrong place."""
        return self.as_good > 0


@one_blas_thread()
def check_place(
    scan: Scan,
    caster: RayCaster,
    *,
    prior: FloatArray,
    known: LidarPlacement = _CLAIMED,
    trajectory: TrajectorySource = "reference",
    sample: int = _SAMPLE,
) -> PlaceCheck:
    """Compare the fit of the shots at their stated positions with that elsewhere.

    Parameters
    ----------
    scan : Scan
        With spacecraft positions and beams, in the frame of the shape.
    caster : RayCaster
        Of the SPC surface.
    prior : (8,) ndarray
        Prior sigmas of the parameters of the estimate
        (:attr:`fusion.scaling.fit.ScaleOptions.prior`).
    known : LidarPlacement, optional
        Estimated placement of the lidar surface, which does not count as a misfit.
    trajectory : {"spc", "reference"}
        Trajectory by which the shots are located.
    sample : int, optional
        Largest number of shots compared.

    Returns
    -------
    PlaceCheck
        Without test if there are fewer than ten shots.
    """
    shots = scan.select(np.arange(0, len(scan), max(1, -(-len(scan) // sample))))
    # A scan without times: dates are not needed, and take longer than the rays.
    shots = Scan.of_points("place", shots.points, spacecraft=shots.spacecraft, beam=shots.beam)
    if len(shots) < FEWEST_SHOTS:
        return PlaceCheck(len(shots))
    compared = _Compared(shots, caster, trajectory)
    center = known.parameters
    claimed = compared.at(Place(Z, 0.0), known)
    here = replace(claimed, value=claimed.value - claimed.design @ center).rest(prior)
    places = list(trial_places(shots.points))
    fits = compared.at_each(places)
    # At other places the fit may rotate between the steps; here only within its prior.
    loose = np.maximum(prior, _LOOSE)
    best = _finer(_best(places, [fit.rest(loose) for fit in fits]), compared, prior * _FIRM)
    there = compared.at(best).rest(loose)
    paired = min(1.0, len(places) * chance_of_larger(here, there))
    noise, count = 0.0, _independent(there)
    if paired < FALSE_ALARM and count >= FEWEST_INDEPENDENT:
        noise = chance_of_fit(claimed, fits, prior=prior, loose=loose, center=center)
    wrong, size = _scatter_elsewhere(places, fits, prior), scatter(here)
    usual = float(np.median(wrong)) if wrong.size else float("nan")
    as_good = int(np.count_nonzero(wrong <= size))
    return PlaceCheck(
        len(shots), size, scatter(there), best, paired, len(places), usual, len(wrong), as_good,
        noise, count,
    )  # fmt: skip


def _scatter_elsewhere(
    places: Sequence[Place], fits: Sequence[PlaceFit], prior: FloatArray
) -> FloatArray:
    """Scatter (W,) of fits with priors (8,) at the wrong places at which enough shots hit."""
    elsewhere = [place.is_elsewhere for place in places]
    wrong = np.array([scatter(fit.rest(prior)) for fit in compress(fits, elsewhere)])
    return wrong[np.isfinite(wrong)]


def _independent(rest: FloatArray) -> float:
    """Effective number of independent residuals (N,), given in order of time."""
    known = rest[np.isfinite(rest)]
    if not known.any():
        return 0.0
    known = clipped(known)
    return independent(known - known.mean(), known - known.mean())


def _best(places: Sequence[Place], rests: Sequence[FloatArray]) -> Place:
    """The place of least scatter; the first if all are NaN."""
    sizes = np.array([scatter(rest) for rest in rests])
    return places[int(np.nanargmin(sizes)) if np.isfinite(sizes).any() else 0]


def _finer(best: Place, compared: _Compared, firm: FloatArray) -> Place:
    """The place of least scatter near `best`, by fits with priors (8,)."""
    for step in _FINER_DEG:
        turns = best.turn_deg + step * np.array([-1.0, 0.0, 1.0])
        near = [Place(best.axis, float(turn), best.mirrored) for turn in turns]
        best = _best(near, [fit.rest(firm) for fit in compared.at_each(near)])
    return best


@dataclass(frozen=True, eq=False)
class _Compared:
    """N shots compared with the shape at any place."""

    scan: Scan
    caster: RayCaster
    trajectory: TrajectorySource

    def at(self, place: Place, known: LidarPlacement = _CLAIMED) -> PlaceFit:
        """Values and partials at a place; of no shots if most miss."""
        return self.at_each([place], known)[0]

    def at_each(self, places: Sequence[Place], known: LidarPlacement = _CLAIMED) -> list[PlaceFit]:
        """Values and partials at each place; of no shots if most miss."""
        most = max(1, _RAYS // len(self.scan))
        groups = [places[first : first + most] for first in range(0, len(places), most)]
        return [fit for group in groups for fit in self._at_once(group, known)]

    def _at_once(self, places: Sequence[Place], known: LidarPlacement) -> list[PlaceFit]:
        """Values and partials at a few places, cast together: rays cost less than calls."""
        count = len(self.scan)
        layers = {
            name: np.concatenate([getattr(self.scan, name) @ place.matrix.T for place in places])
            for name in ("points", "spacecraft", "beam")
        }
        scan = Scan.of_points("places", **layers)
        compared = compare_shots(scan, self.caster, trajectory=self.trajectory, known=known)
        value, design = compared.observations.value[:, 0], compared.observations.design()[:, 0]
        fits, first = [], 0
        for hits in compared.hits.reshape(-1, count):
            number = int(np.count_nonzero(hits))
            enough = number >= max(FEWEST_SHOTS, count / 2)
            part = slice(first, first + number if enough else first)
            fits.append(PlaceFit(hits & enough, value[part], design[part]))
            first += number
        return fits
