"""Whether single shots fit the shape where they claim to be, and where they fit better."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress

import numpy as np
from scipy.spatial.transform import Rotation

from fusion.runtime.machine import one_blas_thread
from fusion.scaling.fit.observation import Trajectory
from fusion.scaling.geometry.placing import KnownPlace
from fusion.scaling.places.chance import (
    FEWEST_INDEPENDENT,
    FEWEST_SHOTS,
    LARGER,
    chance_of_fit,
    chance_of_larger,
    independent,
)
from fusion.scaling.places.fits import PlaceFit, clipped, scatter
from fusion.scaling.shots.shots import compare_shots
from lidar.scans import Scan
from spcola.arrays import FloatArray
from spcola.shape import RayCaster

# Shots compared at each place: more tell no more of it.
_SAMPLE = 400
# Rays cast at once.
_RAYS = 100_000
# Steps of turns about Z, and about axes in the equator, degrees.
_STEP_DEG, _MIRRORED_DEG, _COARSE_DEG = 2.0, 3.0, 4.0
# The best of them is looked for again with these steps, with no rotation left to the fit.
_FINER_DEG = (1.0, 0.5, 0.25)
_LOOSE = np.array([0.0, 0.0, 0.0, 0.0, *np.radians([2.0, 2.0, 2.0]), 0.0])
_FIRM = np.array([1.0, 1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3, 1.0])
# Places closer than this to the one claimed are not wrong ones.
_ELSEWHERE_DEG = 20.0
FALSE_ALARM = 1e-3
"""Chance, of all places together, that right shots seem to fit better elsewhere.

It is kept where errors are white. Where they are correlated along a short track and as large as the
relief it is not quite (docs: truth, "Wrong input").
"""


@dataclass(frozen=True, eq=False)
class Place:
    """Another place for the shots: a turn about an axis, after a mirroring.

    Parameters
    ----------
    axis : (3,) ndarray
        Unit vector, body-fixed.
    turn_deg : float
        About it, right-handed.
    mirrored : str
        What is mirrored before; empty: nothing.
    """

    axis: FloatArray
    turn_deg: float
    mirrored: str = ""

    @property
    def matrix(self) -> FloatArray:
        """What takes the shots there (3, 3)."""
        turn = Rotation.from_rotvec(np.radians(self.turn_deg) * self.axis).as_matrix()
        matrix: FloatArray = turn @ np.diag(_MIRRORS[self.mirrored])
        return matrix

    @property
    def signed_deg(self) -> float:
        """The turn in [−180, 180), degrees."""
        return (self.turn_deg + 180.0) % 360.0 - 180.0

    @property
    def is_elsewhere(self) -> bool:
        """Whether it is another place beyond doubt."""
        return bool(self.mirrored) or abs(self.signed_deg) > _ELSEWHERE_DEG

    @property
    def about_z(self) -> bool:
        """Whether it is a turn about the body's Z axis and nothing else."""
        return not self.mirrored and bool(self.axis[2] == 1.0)

    def __str__(self) -> str:
        turn = self.signed_deg
        axis = "Z" if self.axis[2] == 1.0 else f"({', '.join(f'{x:.2f}' for x in self.axis)})"
        parts = [f"mirrored ({self.mirrored})"] if self.mirrored else []
        parts += [f"turned by {turn:+.1f} deg about {axis}"] if turn or not parts else []
        return " and ".join(parts)


_Z = np.array([0.0, 0.0, 1.0])
_CLAIMED = KnownPlace()
_MIRRORS = {
    "": (1.0, 1.0, 1.0),
    "longitude of the other sign": (1.0, -1.0, 1.0),
    "north for south": (1.0, 1.0, -1.0),
    "through the centre": (-1.0, -1.0, -1.0),
}


@dataclass(frozen=True, eq=False)
class PlaceCheck:
    """How the shots fit where they claim to be, and elsewhere.

    The scatter is that of the range residuals about what the eight parameters of the estimate
    explain within their priors: a wrong radius is no wrong longitude.

    Attributes
    ----------
    count : int
        Shots compared.
    here_m, best_m : float
        Scatter where they claim to be and at the best other place, metres; NaN where less than
        half of the shots meet the shape, or fewer than ten.
    best : Place
    paired : float
        Chance, over all places tried, that the scatter here exceeds the one there as much as it
        does where both fit equally well (:func:`fusion.scaling.places.chance.chance_of_larger`,
        Bonferroni's bound).
    tried : int
        Places.
    usual_m : float
        Median scatter at the wrong places: turned by more than 20°, or mirrored.
    wrong, rivals : int
        How many of these there are, and at how many of them the shots fit as well as here.
    noise : float
        The same chance where right shots have errors correlated as the residuals are
        (:func:`fusion.scaling.places.chance.chance_of_fit`); 0 where `paired` is no less than
        :data:`FALSE_ALARM`, and nothing is left to be asked.
    independent : float
        How many shots are independent by the residuals at the best other place.
    """

    count: int = 0
    here_m: float = float("nan")
    best_m: float = float("nan")
    best: Place = field(default_factory=lambda: Place(_Z, 0.0))
    paired: float = 1.0
    tried: int = 0
    usual_m: float = float("nan")
    wrong: int = 0
    rivals: int = 0
    noise: float = 0.0
    independent: float = 0.0

    @property
    def p_value(self) -> float:
        """The larger of both chances."""
        return max(self.paired, self.noise)

    @property
    def misfit(self) -> bool:
        """Whether the shots fit better elsewhere, by more than chance."""
        known = self.independent >= FEWEST_INDEPENDENT
        return known and self.p_value < FALSE_ALARM and not self.here_m <= LARGER * self.best_m

    @property
    def by_chance(self) -> bool:
        """Whether the fit may be one of chance: it is as good at a place that is a wrong one."""
        return self.rivals > 0


@one_blas_thread()
def check_place(
    scan: Scan,
    caster: RayCaster,
    *,
    prior: FloatArray,
    known: KnownPlace = _CLAIMED,
    trajectory: Trajectory = "reference",
    sample: int = _SAMPLE,
) -> PlaceCheck:
    """Compare the fit of the shots where they claim to be with that elsewhere.

    Parameters
    ----------
    scan : Scan
        With spacecraft positions and beams, in the frame of the shape.
    caster : RayCaster
        Of the SPC surface.
    prior : (8,) ndarray
        Standard deviations of what is believed of the parameters of the estimate
        (:attr:`fusion.scaling.fit.ScaleOptions.prior`).
    known : KnownPlace, optional
        Where an estimate has put the lidar surface: what it tells is no misfit.
    trajectory : {"spc", "reference"}
        By which the shots are located.
    sample : int, optional
        Shots compared at the most.

    Returns
    -------
    PlaceCheck
        Nothing is tested with fewer than ten shots.
    """
    shots = scan.select(np.arange(0, len(scan), max(1, -(-len(scan) // sample))))
    # Dates are not needed, and take longer than the rays.
    shots = Scan.of_points("place", shots.points, spacecraft=shots.spacecraft, beam=shots.beam)
    if len(shots) < FEWEST_SHOTS:
        return PlaceCheck(len(shots))
    compared = _Compared(shots, caster, trajectory)
    center = known.parameters
    claimed = compared.at(Place(_Z, 0.0), known)
    here = replace(claimed, value=claimed.value - claimed.design @ center).rest(prior)
    places = list(_places(shots))
    fits = compared.at_each(places)
    # Between places that are tried the fit turns: here it may not, beyond its prior.
    loose = np.maximum(prior, _LOOSE)
    best = _finer(_best(places, [fit.rest(loose) for fit in fits]), compared, prior * _FIRM)
    there = compared.at(best).rest(loose)
    paired = min(1.0, len(places) * chance_of_larger(here, there))
    noise = 0.0
    count = _independent(there)
    if paired < FALSE_ALARM and count >= FEWEST_INDEPENDENT:
        noise = chance_of_fit(claimed, fits, prior=prior, loose=loose, center=center)
    elsewhere = [place.is_elsewhere for place in places]
    wrong = np.array([scatter(fit.rest(prior)) for fit in compress(fits, elsewhere)])
    wrong = wrong[np.isfinite(wrong)]
    size = scatter(here)
    return PlaceCheck(
        len(shots),
        size,
        scatter(there),
        best,
        paired,
        len(places),
        float(np.median(wrong)) if wrong.size else float("nan"),
        len(wrong),
        int(np.count_nonzero(wrong <= size)),
        noise,
        count,
    )


def _independent(rest: FloatArray) -> float:
    """How many of residuals (N,), in the order in which they were taken, are independent."""
    known = rest[np.isfinite(rest)]
    if not known.any():
        return 0.0
    known = clipped(known)
    return independent(known - known.mean(), known - known.mean())


def _places(scan: Scan) -> Iterator[Place]:
    """Turns about Z, also of mirrored shots, and turns about axes in the equator."""
    for mirrored in _MIRRORS:
        for turn in np.arange(0.0, 360.0, _MIRRORED_DEG if mirrored else _STEP_DEG):
            if turn or mirrored:
                yield Place(_Z, float(turn), mirrored)
    middle = scan.points.mean(axis=0)
    toward = np.arctan2(middle[1], middle[0])
    # The fifth turns the shots to the north and to the south.
    for number in range(8):
        angle = toward + np.pi / 8.0 * number
        axis = np.array([np.cos(angle), np.sin(angle), 0.0])
        step = _STEP_DEG if number == 4 else _COARSE_DEG
        for turn in np.arange(step, 360.0, step):
            yield Place(axis, float(turn))


def _best(places: Sequence[Place], rests: Sequence[FloatArray]) -> Place:
    """The place of the least scatter; the first where none is known."""
    sizes = np.array([scatter(rest) for rest in rests])
    return places[int(np.nanargmin(sizes)) if np.isfinite(sizes).any() else 0]


def _finer(best: Place, compared: _Compared, firm: FloatArray) -> Place:
    """The place near `best` of the least scatter, by fits with priors (8,)."""
    for step in _FINER_DEG:
        turns = best.turn_deg + step * np.array([-1.0, 0.0, 1.0])
        near = [Place(best.axis, float(turn), best.mirrored) for turn in turns]
        best = _best(near, [fit.rest(firm) for fit in compared.at_each(near)])
    return best


@dataclass(frozen=True, eq=False)
class _Compared:
    """N shots against the shape, wherever they are put."""

    scan: Scan
    caster: RayCaster
    trajectory: Trajectory

    def at(self, place: Place, known: KnownPlace = _CLAIMED) -> PlaceFit:
        """Values and partials at a place; of no shot where most miss."""
        return self.at_each([place], known)[0]

    def at_each(self, places: Sequence[Place], known: KnownPlace = _CLAIMED) -> list[PlaceFit]:
        """Values and partials at each place; of no shot where most miss."""
        most = max(1, _RAYS // len(self.scan))
        groups = [places[first : first + most] for first in range(0, len(places), most)]
        return [fit for group in groups for fit in self._at_once(group, known)]

    def _at_once(self, places: Sequence[Place], known: KnownPlace) -> list[PlaceFit]:
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
        for met in compared.met.reshape(-1, count):
            seen = int(np.count_nonzero(met))
            enough = seen >= max(FEWEST_SHOTS, count / 2)
            part = slice(first, first + seen if enough else first)
            fits.append(PlaceFit(met & enough, value[part], design[part]))
            first += seen
        return fits
