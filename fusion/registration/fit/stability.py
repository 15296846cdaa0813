"""How much a registration leans on parts of the body: regions left out, blocks drawn anew."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from fusion.registration.fit.fit import Registration, transform_partials
from fusion.registration.fit.held import HeldEquations, Refit
from spcola.arrays import AnyArray, FloatArray
from spcola.errors import NotObservableError
from spcola.math import lattice
from spcola.math.robust import mad

REGIONS = 20
"""Regions of about equal area that the body is parted into."""

# Chance that any region is named though none moves the result by more than expected.
_ALARM = 0.01
# Changes below this share of the sigma that the fit gives are rounding.
_ROUNDING = 1e-6
# Neighbouring mapolas in a block, and most blocks; fewer than _FEWEST tell no spread.
_BLOCK, _MOST, _FEWEST = 4, 64, 6
# Numbers in the normal matrices of all blocks together: 240 MB.
_MOST_NUMBERS = 3e7


@dataclass(frozen=True, eq=False)
class RegionInfluence:
    """What leaving one region out does.

    Attributes
    ----------
    direction : (3,) ndarray
        Of the region's middle, unit vector, body-fixed.
    count : int
        Mapolas in it that the fit used.
    change : (P,) ndarray
        Parameters without it less those with it; NaN if they are free without it.
    sigma : (P,) ndarray
        Standard deviation that the change should have.
    chi2, p_value : float
        Of all changes together, under what they should be.
    reason : str
        Why there is no change; empty if there is.
    """

    direction: FloatArray
    count: int
    change: FloatArray
    sigma: FloatArray
    chi2: float
    p_value: float
    reason: str = ""

    @property
    def name(self) -> str:
        """Where it is: east longitude and latitude of its middle, degrees."""
        x, y, z = self.direction
        longitude = np.degrees(np.arctan2(y, x)) % 360.0
        return f"longitude {longitude:.0f}, latitude {np.degrees(np.arcsin(z)):+.0f}"


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Spread of the parameters over sets of blocks drawn with replacement.

    Attributes
    ----------
    sigma : (P,) ndarray
        1.4826 × median absolute deviation; NaN with too few blocks.
    blocks, samples : int
    reason : str
        Why there is no spread; empty if there is.
    """

    sigma: FloatArray
    blocks: int
    samples: int
    reason: str = ""


def region_numbers(points: FloatArray, count: int = REGIONS) -> AnyArray:
    """Number (N,) of the region in which each point (N, 3) lies, seen from the origin."""
    numbers: AnyArray = np.argmax(points @ lattice(count).T, axis=1)
    return numbers


def leave_one_region_out(
    registration: Registration, centers: FloatArray
) -> tuple[RegionInfluence, ...]:
    """Fit without each region that holds mapolas, weights and error sizes as they were found.

    The change of an efficient estimate when data are left out has the covariance C_without − C
    (Hausman 1978).

    Parameters
    ----------
    registration : Registration
    centers : (N, 3) ndarray
        Mapola centres that it was fitted to, lidar coordinates, metres.

    Returns
    -------
    tuple of RegionInfluence
        In the order of the lattice, from north to south; parameters about the body's origin.
    """
    held, origin = _held(registration, centers)
    numbers = region_numbers(centers[registration.fit.used])
    whole = held.solved(*held.normal(np.ones(len(numbers), dtype=bool)))
    directions, found = lattice(REGIONS), []
    for number in np.unique(numbers).tolist():
        inside = numbers == number
        direction, count = directions[number], int(np.count_nonzero(inside))
        try:
            rest = held.refit(~inside, registration.parameters)
        except NotObservableError as error:
            free = np.full(len(registration.parameters), np.nan)
            nan, reason = float("nan"), f"without it {error.what}"
            found.append(RegionInfluence(direction, count, free, free, nan, nan, reason))
        else:
            found.append(_influence(direction, count, whole, rest, origin))
    return tuple(found)


def _influence(
    direction: FloatArray, count: int, whole: Refit, rest: Refit, origin: FloatArray
) -> RegionInfluence:
    """Compare a refit with the whole fit."""
    change = rest.change - whole.change
    unit = np.sqrt(np.diag(whole.covariance))
    expected = (rest.covariance - whole.covariance) / np.outer(unit, unit)
    values, vectors = np.linalg.eigh((expected + expected.T) / 2.0)
    told = values > _ROUNDING * max(float(values[-1]), _ROUNDING)
    chi2 = float(np.sum((vectors.T @ (change / unit))[told] ** 2 / values[told]))
    carried = origin @ (rest.covariance - whole.covariance) @ origin.T
    return RegionInfluence(
        direction=direction,
        count=count,
        change=origin @ change,
        sigma=np.sqrt(np.maximum(np.diag(carried), 0.0)),
        chi2=chi2,
        p_value=float(stats.chi2.sf(chi2, np.count_nonzero(told))),
    )


def block_bootstrap(
    registration: Registration, centers: FloatArray, *, samples: int = 200, seed: int = 0
) -> Bootstrap:
    """Spread of the parameters when blocks of neighbouring mapolas are drawn with replacement.

    Weights and error sizes stay as the fit found them. Errors that neighbours share count as
    shared; what all mapolas share cannot be seen by drawing among them.

    Parameters
    ----------
    registration : Registration
    centers : (N, 3) ndarray
        Mapola centres that it was fitted to, lidar coordinates, metres.
    samples : int
        Sets drawn.
    seed : int
        Of the generator.

    Returns
    -------
    Bootstrap
        About the body's origin, in the order of ``registration.parameters``. Source: Künsch (1989).
    """
    held, origin = _held(registration, centers)
    used = centers[registration.fit.used]
    size = held.rows.shape[2]
    most = min(len(used) // _BLOCK, _MOST, int(_MOST_NUMBERS / size**2))
    if most < _FEWEST:
        reason = f"{len(used)} mapolas make too few blocks of neighbours"
        return Bootstrap(np.full(len(origin), np.nan), max(most, 0), 0, reason)
    parts = [held.normal(members) for members in _blocks(used, most)]
    normals, rights = np.stack([part[0] for part in parts]), np.stack([part[1] for part in parts])
    generator = np.random.default_rng(seed)
    drawn = generator.multinomial(most, np.full(most, 1.0 / most), size=samples)
    found = []
    for times in drawn.astype(np.float64):
        try:
            refit = held.solved(np.tensordot(times, normals, axes=1), times @ rights)
        except np.linalg.LinAlgError:
            continue
        found.append(origin @ refit.change)
    if len(found) <= samples / 2:
        reason = "most sets of blocks leave parameters free"
        return Bootstrap(np.full(len(origin), np.nan), most, len(found), reason)
    return Bootstrap(mad(np.array(found), axis=0), most, len(found))


def _held(registration: Registration, centers: FloatArray) -> tuple[HeldEquations, FloatArray]:
    """The equations about the mapolas' centre, and what carries a change (P,) to the origin."""
    similarity, center = registration.similarity, registration.center
    design = transform_partials(registration.model, similarity, centers, center)
    origin = np.eye(design.shape[2])
    origin[:3] = transform_partials(registration.model, similarity, np.zeros((1, 3)), center)[0]
    return HeldEquations.of(registration.observations, registration.fit, design), origin


def _blocks(points: FloatArray, count: int) -> list[AnyArray]:
    """Part points (N, 3) into `count` blocks of neighbours, about equally many in each.

    Halved again and again across the axis along which they reach furthest.
    """
    waiting, done = [(np.arange(len(points)), count)], []
    while waiting:
        members, parts = waiting.pop()
        if parts == 1:
            done.append(members)
            continue
        axis = int(np.argmax(np.ptp(points[members], axis=0)))
        order = members[np.argsort(points[members, axis], kind="stable")]
        first = parts // 2
        cut = len(order) * first // parts
        waiting += [(order[:cut], first), (order[cut:], parts - first)]
    return done


def stability_json(registration: Registration, centers: FloatArray) -> dict[str, Any]:
    """Return the `stability` of ``registration.json``."""
    regions = leave_one_region_out(registration, centers)
    bootstrap = block_bootstrap(registration, centers)
    return {
        "parameters": list(registration.parameters),
        "formal_sigma": np.sqrt(np.diag(registration.covariance)),
        "bootstrap_sigma": bootstrap.sigma,
        "bootstrap_blocks": bootstrap.blocks,
        "bootstrap_samples": bootstrap.samples,
        "bootstrap_reason": bootstrap.reason,
        "regions": [
            {
                "region": region.name,
                "n": region.count,
                "change": region.change,
                "change_sigma": region.sigma,
                "chi2": region.chi2,
                "p_value": region.p_value,
                "reason": region.reason,
            }
            for region in regions
        ],
        "suspect_regions": [region.name for region in suspects(regions)],
    }


def suspects(regions: tuple[RegionInfluence, ...]) -> list[RegionInfluence]:
    """Regions that move the result by more than expected, at 1 % for all of them together."""
    return [region for region in regions if region.p_value < _ALARM / len(regions)]
