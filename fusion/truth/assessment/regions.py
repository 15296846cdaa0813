"""Regions of the surface, and the errors in each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from fusion.truth.assessment.settings import AssessmentSettings
from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.math.robust import mad
from spcola.truth.body import BOULDER, CRATER, SMOOTH, TruthBody

Light = Callable[[FloatArray], FloatArray]
"""Share of a rotation (N,), 0 … 1, for which the surface in directions (N, 3) is lit."""

BANDS_DEG: Mapping[str, tuple[float, float]] = {
    "latitude −90 … −60°": (-90.0, -60.0),
    "latitude −60 … −30°": (-60.0, -30.0),
    "latitude −30 … 30°": (-30.0, 30.0),
    "latitude 30 … 60°": (30.0, 60.0),
    "latitude 60 … 90°": (60.0, 90.0),
}
REGIONS = (
    "all",
    "lit",
    "shadowed",
    "boulders",
    "craters",
    "smooth site",
    "other ground",
    *BANDS_DEG,
)
"""Names of the regions; the n-th bit of :meth:`Ground.regions` belongs to the n-th."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Assigns points of the truth surface to regions.

    Parameters
    ----------
    truth : TruthBody
    light : callable
        See :data:`Light`.
    settings : AssessmentSettings
    """

    truth: TruthBody
    light: Light
    settings: AssessmentSettings

    def regions(self, places: FloatArray) -> AnyArray:
        """Return the regions of `places` (N, 3), body-fixed, metres, as bits (N,), uint16.

        The limit of lit and shadowed is ``dark_share``. Boulders are within their outlines,
        craters inside their rims but not on boulders, other ground is outside of these and of the
        smooth site. Bands are of planetocentric latitude.
        """
        flags = self.truth.terrain(places, smallest=self.settings.smallest)
        dark = self.light(places) < self.settings.dark_share
        latitude = np.degrees(np.arctan2(places[:, 2], np.hypot(places[:, 0], places[:, 1])))
        masks = {
            "all": np.ones(len(places), dtype=bool),
            "lit": np.logical_not(dark),
            "shadowed": dark,
            "boulders": flags & BOULDER > 0,
            "craters": (flags & CRATER > 0) & (flags & BOULDER == 0),
            "smooth site": flags & SMOOTH > 0,
            "other ground": flags & (BOULDER | CRATER | SMOOTH) == 0,
        }
        for name, (south, north) in BANDS_DEG.items():
            top = latitude <= north if north == 90.0 else latitude < north
            masks[name] = (latitude >= south) & top
        bits = np.zeros(len(places), dtype=np.uint16)
        for number, name in enumerate(REGIONS):
            bits |= masks[name].astype(np.uint16) << number
        return bits


@dataclass(frozen=True, eq=False)
class PointErrors:
    """Errors of N points of a model.

    Parameters
    ----------
    height : (N,) ndarray
        Model minus truth along Uz of its grid, metres.
    slope : (N,) ndarray
        Angle between the normals of model and truth, radians; NaN at edges.
    sigma : (N,) ndarray
        Sigma of the height that the model states, metres; NaN where it states none.
    direction : (N, 3) ndarray
        Unit vectors to the points.
    regions : (N,) ndarray
        Bits, as :meth:`Ground.regions` gives them.
    """

    height: FloatArray
    slope: FloatArray
    sigma: FloatArray
    direction: FloatArray
    regions: AnyArray

    def within(self, region: str) -> BoolArray:
        """Return which points (N,) lie in a region of :data:`REGIONS`."""
        mask: BoolArray = (self.regions >> REGIONS.index(region)) & 1 > 0
        return mask


@dataclass(frozen=True)
class RegionScore:
    """Errors of a model in one region; NaN where there are no points or sigmas.

    Attributes
    ----------
    region : str
    count : int
        Points with a height; all points of overlapping maplets count.
    mean, rms : float
        Mean and root mean square of the height errors, metres.
    robust : float
        1.4826 × median absolute deviation of the height errors from their median, metres.
    largest : float
        Largest absolute height error, metres.
    slope_rms_deg : float
        Root mean square angle between the normals of model and truth, degrees.
    sigma_rms : float
        Root mean square of the stated sigmas, metres.
    pull_mean, pull_std : float
        Mean and standard deviation of error / sigma: 0 and 1 if the sigmas are correct.
    within_1, within_2 : float
        Shares of the errors within one and two stated sigmas: 0.683 and 0.954 if they are correct
        and the errors normal.
    """

    region: str
    count: int
    mean: float
    rms: float
    robust: float
    largest: float
    slope_rms_deg: float
    sigma_rms: float
    pull_mean: float
    pull_std: float
    within_1: float
    within_2: float


def score_regions(errors: PointErrors) -> list[RegionScore]:
    """Return the scores of every region, in the order of :data:`REGIONS`."""
    return [_score(name, errors, errors.within(name)) for name in REGIONS]


def _score(region: str, errors: PointErrors, mask: BoolArray) -> RegionScore:
    error = errors.height[mask].astype(np.float64)
    if not len(error):
        return RegionScore(region, 0, *[float("nan")] * 10)
    sigma = errors.sigma[mask].astype(np.float64)
    stated = sigma > 0
    pull = error[stated] / sigma[stated]
    slope = errors.slope[mask]
    return RegionScore(
        region,
        len(error),
        float(np.mean(error)),
        _rms(error),
        float(mad(error)),
        float(np.max(np.abs(error))),
        float(np.degrees(_rms(slope[np.isfinite(slope)]))),
        _rms(sigma[stated]),
        float(np.mean(pull)) if len(pull) else float("nan"),
        float(np.std(pull)) if len(pull) else float("nan"),
        *(float(np.mean(np.abs(pull) <= k)) if len(pull) else float("nan") for k in (1, 2)),
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values.astype(np.float64) ** 2))) if len(values) else float("nan")
