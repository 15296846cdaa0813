"""Influence of parts of the body on a registration: regions left out, block bootstrap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.registration.fit.fit import Registration
from fusion.registration.fit.fixed_weights import FixedWeightEquations, Refit
from fusion.registration.transform.parameters import origin_jacobian
from spcola.arrays import AnyArray, FloatArray
from spcola.errors import NotObservableError
from spcola.math import lattice
from spcola.math.robust import mad
from spcola.math.statistics import chi_square_tail

REGIONS = 20
"""Number of regions of about equal area into which the body is divided."""

# Probability of a false alarm over all regions together.
_ALARM = 0.01
# Changes below this share of the fit's sigma are rounding errors.
_ROUNDING = 1e-6
# Neighbouring mapolas in a block, and most blocks; fewer than _FEWEST do not determine a spread.
_BLOCK, _MOST, _FEWEST = 4, 64, 6
# Numbers in the normal matrices of all blocks together: 240 MB.
_MOST_NUMBERS = 3e7


@dataclass(frozen=True, eq=False)
class RegionInfluence:
    """Change of a registration when one region is left out.

    Attributes
    ----------
    direction : (3,) ndarray
        Of the region's middle, unit vector, body-fixed.
    count : int
        Number of its mapolas used in the fit.
    change : (P,) ndarray
        Parameters without the region minus those with it; NaN if they are then not determined.
    sigma : (P,) ndarray
        Expected standard deviation of the change.
    chi2, p_value : float
        Of all changes together, given their expected covariance.
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
        """East longitude and latitude of its middle, degrees."""
        x, y, z = self.direction
        longitude = np.degrees(np.arctan2(y, x)) % 360.0
        return f"longitude {longitude:.0f}, latitude {np.degrees(np.arcsin(z)):+.0f}"


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Spread of the parameters in a block bootstrap.

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


def region_numbers(points: FloatArray) -> AnyArray:
    """Region number (N,) of the direction of each point (N, 3) from the origin."""
    numbers: AnyArray = np.argmax(points @ lattice(REGIONS).T, axis=1)
    return numbers


def leave_one_region_out(registration: Registration) -> tuple[RegionInfluence, ...]:
    """Fit without each region that has mapolas, at the weights and error sizes of the fit.

    The change of an efficient estimate when data are left out has the covariance C_without − C
    (Hausman 1978).

    Returns
    -------
    tuple of RegionInfluence
        In the order of the lattice, from north to south; parameters about the body's origin.
    """
    equations, origin = _equations(registration)
    numbers = region_numbers(registration.centers[registration.fit.used])
    whole = equations.solved(*equations.normal(np.ones(len(numbers), dtype=bool)))
    directions, found = lattice(REGIONS), []
    for number in np.unique(numbers).tolist():
        inside = numbers == number
        direction, count = directions[number], int(np.count_nonzero(inside))
        try:
            rest = equations.refit(~inside)
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
    changed = values > _ROUNDING * max(float(values[-1]), _ROUNDING)
    chi2 = float(np.sum((vectors.T @ (change / unit))[changed] ** 2 / values[changed]))
    spread = origin @ (rest.covariance - whole.covariance) @ origin.T
    return RegionInfluence(
        direction=direction,
        count=count,
        change=origin @ change,
        sigma=np.sqrt(np.maximum(np.diag(spread), 0.0)),
        chi2=chi2,
        p_value=chi_square_tail(chi2, int(np.count_nonzero(changed))),
    )


def block_bootstrap(registration: Registration, *, samples: int = 200, seed: int = 0) -> Bootstrap:
    """Spread of the parameters when blocks of neighbouring mapolas are drawn with replacement.

    Weights and error sizes are those of the fit. The spread includes errors that neighbours share,
    but not errors that all mapolas share.

    Parameters
    ----------
    registration : Registration
    samples : int
        Number of sets drawn.
    seed : int
        Of the random generator.

    Returns
    -------
    Bootstrap
        About the body's origin, in the order of ``registration.parameters``. Source: Künsch (1989).
    """
    equations, origin = _equations(registration)
    used = registration.centers[registration.fit.used]
    size = equations.rows.shape[2]
    most = min(len(used) // _BLOCK, _MOST, int(_MOST_NUMBERS / size**2))
    if most < _FEWEST:
        reason = f"{len(used)} mapolas make too few blocks of neighbours"
        return Bootstrap(np.full(len(origin), np.nan), max(most, 0), 0, reason)
    parts = [equations.normal(members) for members in _blocks(used, most)]
    normals, rights = np.stack([part[0] for part in parts]), np.stack([part[1] for part in parts])
    generator = np.random.default_rng(seed)
    drawn = generator.multinomial(most, np.full(most, 1.0 / most), size=samples)
    found = []
    for times in drawn.astype(np.float64):
        try:
            refit = equations.solved(np.tensordot(times, normals, axes=1), times @ rights)
        except np.linalg.LinAlgError:
            continue
        found.append(origin @ refit.change)
    if len(found) <= samples / 2:
        reason = "most sets of blocks do not determine all parameters"
        return Bootstrap(np.full(len(origin), np.nan), most, len(found), reason)
    return Bootstrap(mad(np.array(found), axis=0), most, len(found))


def _equations(registration: Registration) -> tuple[FixedWeightEquations, FloatArray]:
    """Equations about the mapolas' centre, and the matrix (P, P) that refers them to the origin."""
    model = registration.model
    origin = origin_jacobian(model, registration.similarity, registration.center)
    return FixedWeightEquations.of(registration, model), origin


def _blocks(points: FloatArray, count: int) -> list[AnyArray]:
    """Divide points (N, 3) into `count` blocks of neighbours, about equally many in each.

    By repeated halving across the axis of largest extent.
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


def stability_json(registration: Registration) -> dict[str, Any]:
    """Return the `stability` of ``registration.json``."""
    regions = leave_one_region_out(registration)
    bootstrap = block_bootstrap(registration)
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
    """Regions that change the result significantly, at 1 % for all of them together."""
    return [region for region in regions if region.p_value < _ALARM / len(regions)]
