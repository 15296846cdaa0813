"""Whether single shots fit the shape where they claim to be, and where they fit better."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

from fusion.scaling.observation import Trajectory
from fusion.scaling.placing import KnownPlace
from fusion.scaling.shots import compare_shots
from lidar.scan import Scan
from spcola.arrays import FloatArray
from spcola.rays import RayCaster
from spcola.robust import mad

# Shots compared at each place: more tell no more of it.
_SAMPLE = 400
# Rays cast at once.
_RAYS = 100_000
# Residuals that scatter by less than this are as good as none.
_LEAST_M = 1e-6
# Fewer than this leave nothing once size and centre are taken out.
FEWEST_SHOTS = 10
# Steps of turns about Z, and about axes in the equator, degrees.
_STEP_DEG, _MIRRORED_DEG, _COARSE_DEG = 2.0, 3.0, 4.0
# The best of them is looked for again with these steps, with no rotation left to the fit.
_FINER_DEG = (1.0, 0.5, 0.25)
_LOOSE = np.array([0.0, 0.0, 0.0, 0.0, *np.radians([2.0, 2.0, 2.0]), 0.0])
_FIRM = np.array([1.0, 1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3, 1.0])
# Places closer than this to the one claimed are not wrong ones.
_ELSEWHERE_DEG = 20.0
# Another place is a better one if the scatter here is so much larger, and not by chance.
_LARGER = 1.2
FALSE_ALARM = 1e-3
"""Chance, per run, that right shots are said to fit better elsewhere; an upper bound."""
# Residuals beyond this many robust deviations are of stray shots.
_CLIPPED = 4.0


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
    p_value : float
        Chance, over all places tried, that the scatter here exceeds the one there as much as it
        does where both fit equally well (:func:`chance_of_larger`, Bonferroni's bound).
    tried : int
        Places.
    usual_m : float
        Median scatter at the wrong places: turned by more than 20°, or mirrored.
    wrong, rivals : int
        How many of these there are, and at how many of them the shots fit as well as here.
    """

    count: int = 0
    here_m: float = float("nan")
    best_m: float = float("nan")
    best: Place = field(default_factory=lambda: Place(_Z, 0.0))
    p_value: float = 1.0
    tried: int = 0
    usual_m: float = float("nan")
    wrong: int = 0
    rivals: int = 0

    @property
    def misfit(self) -> bool:
        """Whether the shots fit better elsewhere, by more than chance."""
        return self.p_value < FALSE_ALARM and not self.here_m <= _LARGER * self.best_m

    @property
    def by_chance(self) -> bool:
        """Whether the fit may be one of chance: it is as good at a place that is a wrong one."""
        return self.rivals > 0


def check_place(
    scan: Scan,
    caster: RayCaster,
    *,
    prior: FloatArray,
    known: KnownPlace = _CLAIMED,
    trajectory: Trajectory = "reference",
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
        (:attr:`fusion.scaling.joint.ScaleOptions.prior`).
    known : KnownPlace, optional
        Where an estimate has put the lidar surface: what it tells is no misfit.

    trajectory : {"spc", "reference"}
        By which the shots are located.

    Returns
    -------
    PlaceCheck
        Nothing is tested with fewer than ten shots.
    """
    shots = scan.select(np.arange(0, len(scan), max(1, -(-len(scan) // _SAMPLE))))
    # Dates are not needed, and take longer than the rays.
    shots = Scan.of_points("place", shots.points, spacecraft=shots.spacecraft, beam=shots.beam)
    if len(shots) < FEWEST_SHOTS:
        return PlaceCheck(len(shots))
    compared = _Compared(shots, caster, prior, trajectory)
    here = compared.at(Place(_Z, 0.0), known)
    places = list(_places(shots))
    # Between places that are tried the fit turns: here it may not, beyond what is believed.
    loose = replace(compared, prior=np.maximum(prior, _LOOSE))
    best, _ = _best(list(zip(places, loose.at_each(places), strict=True)))
    best = _finer(best, replace(compared, prior=prior * _FIRM))
    there = loose.at(best)
    elsewhere = [place for place in places if place.is_elsewhere]
    wrong = np.array([scatter(rest) for rest in compared.at_each(elsewhere)])
    wrong = wrong[np.isfinite(wrong)]
    size = scatter(here)
    return PlaceCheck(
        len(shots),
        size,
        scatter(there),
        best,
        min(1.0, len(places) * chance_of_larger(here, there)),
        len(places),
        float(np.median(wrong)) if wrong.size else float("nan"),
        len(wrong),
        int(np.count_nonzero(wrong <= size)),
    )


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


def _best(found: list[tuple[Place, FloatArray]]) -> tuple[Place, FloatArray]:
    """The place of the least scatter; the first where none is known."""
    sizes = np.array([scatter(rest) for _, rest in found])
    return found[int(np.nanargmin(sizes)) if np.isfinite(sizes).any() else 0]


def _finer(best: Place, compared: _Compared) -> Place:
    """The place near `best` of the least scatter."""
    for step in _FINER_DEG:
        turns = best.turn_deg + step * np.array([-1.0, 0.0, 1.0])
        near = [Place(best.axis, float(turn), best.mirrored) for turn in turns]
        best, _ = _best(list(zip(near, compared.at_each(near), strict=True)))
    return best


@dataclass(frozen=True, eq=False)
class _Compared:
    """N shots against the shape, wherever they are put."""

    scan: Scan
    caster: RayCaster
    prior: FloatArray
    trajectory: Trajectory

    def at(self, place: Place, known: KnownPlace = _CLAIMED) -> FloatArray:
        """Residuals (N,) at a place, metres; NaN of shots that miss."""
        return self.at_each([place], known)[0]

    def at_each(self, places: Sequence[Place], known: KnownPlace = _CLAIMED) -> list[FloatArray]:
        """Residuals (N,) at each place, metres; NaN of shots that miss, and where most do."""
        most = max(1, _RAYS // len(self.scan))
        groups = [places[first : first + most] for first in range(0, len(places), most)]
        return [rest for group in groups for rest in self._at_once(group, known)]

    def _at_once(self, places: Sequence[Place], known: KnownPlace) -> list[FloatArray]:
        """Residuals at a few places, cast together: rays cost less than calls."""
        count = len(self.scan)
        layers = {
            name: np.concatenate([getattr(self.scan, name) @ place.matrix.T for place in places])
            for name in ("points", "spacecraft", "beam")
        }
        scan = Scan.of_points("places", **layers)
        compared = compare_shots(scan, self.caster, trajectory=self.trajectory, known=known)
        seen, found = compared.observations, []
        design = seen.design()[:, 0]
        ends = np.concatenate([[0], np.cumsum(compared.met.reshape(-1, count).sum(axis=1))])
        for number, met in enumerate(compared.met.reshape(-1, count)):
            rest = np.full(count, np.nan)
            if np.count_nonzero(met) >= max(FEWEST_SHOTS, count / 2):
                part = slice(ends[number], ends[number + 1])
                rest[met] = self._rest(seen.value[part, 0], design[part], known)
            found.append(rest)
        return found

    def _rest(self, value: FloatArray, design: FloatArray, known: KnownPlace) -> FloatArray:
        """What a fit of the eight parameters with their priors leaves of M values, metres."""
        prior = self.prior
        value = value - design @ np.concatenate([[0.0], known.center, known.turn, [0.0]])
        held = _held(value)
        error = max(float(mad(value)), _LEAST_M)
        rows = np.concatenate([design, np.diag(error / prior)])
        seen = np.concatenate([held, np.zeros(len(prior))])
        # Metres, radians and ratios: in units of the priors the columns are of one size.
        told = prior * np.linalg.lstsq(rows * prior, seen, rcond=None)[0]
        rest: FloatArray = value - design @ told
        return rest


def scatter(rest: FloatArray) -> float:
    """Standard deviation of residuals (N,), stray ones held; NaN where none is known."""
    known = rest[np.isfinite(rest)]
    return float(np.std(_held(known))) if known.size else float("nan")


def chance_of_larger(here: FloatArray, there: FloatArray) -> float:
    """Chance that residuals scatter more here than there as much as they do, if both fit alike.

    Residuals here are explained by the share β of their difference from those there: 0 where all
    is right here, 1 where it is there, and ½ where both scatter alike (which is the test of Pitman
    1939 and Morgan 1939). Shots that follow each other may err alike: as many of them count as
    the correlations along the track leave independent (Pyper & Peterman 1998).

    Parameters
    ----------
    here, there : (N,) ndarray
        Residuals of the same shots, in the order in which they were taken; NaN where unknown.

    Returns
    -------
    float
        One-sided p-value of β against ½. 1 where nothing is known there, 0 where nothing is known
        here only.
    """
    if not np.isfinite(there).any():
        return 1.0
    if not np.isfinite(here).any():
        return 0.0
    both = np.isfinite(here) & np.isfinite(there)
    if np.count_nonzero(both) < FEWEST_SHOTS:
        return 1.0
    one, other = _held(here[both]), _held(there[both])
    one, less = one - one.mean(), (one - other) - (one - other).mean()
    size = float(less @ less)
    if not size > 0:
        return 1.0
    share = float(one @ less) / size
    rest = one - share * less
    count = independent(rest, less)
    error = float(np.sqrt((rest @ rest) / size / (count - 2.0)))
    return float(stats.t.sf((share - 0.5) / max(error, 1e-12), count - 2.0))


def independent(one: FloatArray, other: FloatArray) -> float:
    """How many of N pairs of two series, each of mean 0, count for their correlation: 4 to N."""
    count = len(one)
    own = np.correlate(one, one, "full")[count - 1 :] / (one @ one)
    others = np.correlate(other, other, "full")[count - 1 :] / (other @ other)
    lags = np.arange(1, max(2, count // 5 + 1))
    alike = float(np.sum((1.0 - lags / count) * own[lags] * others[lags]))
    return float(np.clip(count / max(1.0 + 2.0 * alike, 1.0), 4.0, count))


def _held(rest: FloatArray) -> FloatArray:
    """Residuals held within four robust deviations of their median."""
    middle, limit = np.median(rest), _CLIPPED * float(mad(rest))
    return rest if not limit > 0 else np.clip(rest, middle - limit, middle + limit)
