"""The joint estimate of scale, offset of the centre, rotation and range bias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.estimation import (
    ErrorSizes,
    MixedFit,
    MixedOptions,
    Observations,
    fit_mixed,
)
from fusion.scaling.fit.ground import SharedGround, shared_ground
from fusion.scaling.fit.groups import ErrorGroups
from fusion.scaling.fit.observation import PARAMETERS, ScaleObservations
from fusion.scaling.fit.trends import (
    DayScale,
    Trend,
    by_day,
    days_differ,
    trends,
)
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError

# A parameter whose sigma is still this share of its prior was not determined by the data.
_LEARNT = 0.7
# Correlation beyond which two parameters are said to be inseparable.
_INSEPARABLE = 0.95
# Ranges of days may be off by so many times what is expected of them before they disagree: the
# expectation is a median.
_DAYS = 2.0
# The first fit takes errors of the ground for those of days and states where it can; the second
# leaves them to the ground, and tells better how far they reach.
_GROUND_ROUNDS = 2


@dataclass(frozen=True)
class ScaleOptions:
    """Priors and error sizes of the joint estimate.

    A prior is the standard deviation of what is believed before the data; with the data silent,
    it is what the sigma comes out as.

    Parameters
    ----------
    epsilon_prior : float
        Dimensionless.
    center_prior_m : float
        Each component of the offset of the centre, metres.
    meridian_prior_deg, pole_prior_deg : float
        Rotation about Z, and about X and Y, degrees.
    range_bias_prior_m : float
        Constant error of the measured range, metres.
    single_sigma_m : float
        Prior median of the error of one observation beyond its own covariance, metres (of its
        maplets; of the resolution of the shape); its size is estimated.
    state_sigma_m : float
        Prior median of the error of an image's state (or of a scan's trajectory), metres, per
        axis; estimated. 0: none.
    scan_sigma_m : float
        Error of a scan's pointing on the ground, metres, each way across the beam, where states
        of images locate its returns. 0: none.
    day_sigma_m : float
        Prior median of the error that the ranges of a day share, metres; estimated. 0: none.
    reject : float
        Observations further off than this many standard deviations are rejected.
    """

    epsilon_prior: float = 0.01
    center_prior_m: float = 10.0
    meridian_prior_deg: float = 1.0
    pole_prior_deg: float = 0.1
    range_bias_prior_m: float = 0.03
    single_sigma_m: float = 0.1
    state_sigma_m: float = 0.2
    scan_sigma_m: float = 0.05
    day_sigma_m: float = 0.02
    reject: float = 5.0

    @property
    def prior(self) -> FloatArray:
        """Standard deviations (8,) in the order of :data:`PARAMETERS`, SI."""
        pole, meridian = np.radians([self.pole_prior_deg, self.meridian_prior_deg])
        center = [self.center_prior_m] * 3
        return np.array(
            [self.epsilon_prior, *center, pole, pole, meridian, self.range_bias_prior_m]
        )


@dataclass(frozen=True, eq=False)
class ScaleEstimate:
    """The joint estimate.

    Attributes
    ----------
    fit : MixedFit
        Parameters in the order of :data:`PARAMETERS`, covariance, residuals, weights.
    equations : Observations
        What was fitted.
    days : tuple of DayScale
    trends : dict of str to Trend
        "longitude" and, where the Sun is known, "local_time".
    reasons : tuple of str
        Which terms the data do not determine, or not separately, and why.
    ground : SharedGround or None
        What single shots were found to share on the same ground.
    days_p_value : float
        Chance that the ranges of single days differ as much as they do.
    """

    fit: MixedFit
    equations: Observations
    days: tuple[DayScale, ...]
    trends: dict[str, Trend]
    reasons: tuple[str, ...]
    ground: SharedGround | None = None
    days_p_value: float = 1.0

    @property
    def inseparable(self) -> tuple[tuple[str, float], ...]:
        """Parameters that the data do not tell from ε, and their correlations with it."""
        sigma = self.fit.sigma
        correlation = self.fit.covariance[0] / (sigma[0] * sigma)
        return tuple(
            (name, float(value))
            for name, value in zip(PARAMETERS[1:], correlation[1:], strict=True)
            if abs(value) > _INSEPARABLE
        )

    def undetermined(self, options: ScaleOptions) -> tuple[str, ...]:
        """Parameters that the data leave to the priors of `options`."""
        loose = self.fit.sigma > _LEARNT * options.prior
        return tuple(name for name, left in zip(PARAMETERS, loose, strict=True) if left)

    @property
    def epsilon(self) -> float:
        """All SPC lengths are to be multiplied by 1 + ε: above 0 the SPC body is too small."""
        return float(self.fit.estimate[0])

    @property
    def epsilon_sigma(self) -> float:
        """One standard deviation of ε."""
        return float(self.fit.sigma[0])


def estimate_scale(
    observations: ScaleObservations, *, options: ScaleOptions | None = None
) -> ScaleEstimate:
    """Estimate ε with all that could be mistaken for it, robustly (docs: derivations §17).

    Parameters
    ----------
    observations : ScaleObservations
    options : ScaleOptions, optional

    Returns
    -------
    ScaleEstimate
        Terms that the data leave to their priors are named in its `reasons`: no error is raised.

    Raises
    ------
    NotObservableError
        If there are fewer than two observations.
    """
    options = options or ScaleOptions()
    if len(observations) < 2:
        raise NotObservableError(
            f"{len(observations)} usable observation(s) cannot give a scale with its sigma",
            PARAMETERS,
            do="add images or scans, or relax the selection",
        )
    groups, equations, fit = _fit(observations, options)
    ground, alone = None, observations
    for _ in range(_GROUND_ROUNDS if observations.kind == "shots" else 0):
        found = shared_ground(alone, equations, fit)
        if found is None or (ground is not None and found.reach_m == ground.reach_m):
            break
        ground, observations = found, found.under(alone)
        groups, equations, fit = _fit(observations, options)
    return ScaleEstimate(
        fit,
        equations,
        by_day(observations, fit, groups),
        trends(observations, fit, groups),
        _reasons(fit, options, observations, len(set(observations.day))),
        ground,
        days_differ(observations, fit, groups, expected_m=_DAYS * options.day_sigma_m),
    )


def _fit(
    observations: ScaleObservations, options: ScaleOptions
) -> tuple[ErrorGroups, Observations, MixedFit]:
    """Set up the equations of the estimate and solve them."""
    groups = ErrorGroups.of(
        observations, options.state_sigma_m, options.scan_sigma_m, options.day_sigma_m
    )
    mixed = MixedOptions(
        prior=options.prior,
        sizes=ErrorSizes(options.single_sigma_m, groups.sizes),
        scale=options.prior,
        names=PARAMETERS,
        reject=options.reject,
    )
    equations = Observations(
        observations.value,
        observations.design(),
        observations.covariance,
        groups.entering(observations),
    )
    return groups, equations, fit_mixed(equations, mixed)


def _reasons(
    fit: MixedFit, options: ScaleOptions, observations: ScaleObservations, days: int
) -> tuple[str, ...]:
    """Say what the data do not determine, and what they do not tell apart."""
    sigma, lines = fit.sigma, []
    for name, spread, prior in zip(PARAMETERS, sigma, options.prior, strict=True):
        if spread > _LEARNT * prior:
            lines.append(
                f"{name}: not determined by the data; its sigma {spread:.3g} is that of the prior "
                f"({prior:.3g})"
            )
    correlation = fit.covariance / np.outer(sigma, sigma)
    for other in range(1, len(PARAMETERS)):
        if abs(correlation[0, other]) > _INSEPARABLE:
            lines.append(
                f"epsilon and {PARAMETERS[other]} are not separable (correlation "
                f"{correlation[0, other]:+.3f}): the sigma of epsilon holds what the prior leaves"
            )
    if days == 1:
        lines.append("per-day terms: all observations are of one day")
    spread_of_range = float(np.ptp(observations.range) / np.mean(observations.range))
    if spread_of_range < 0.05 and observations.trajectory == "spc":
        lines.append(
            f"range_bias_m: the ranges vary by {spread_of_range:.1%} only, so a constant bias "
            "looks like a scale"
        )
    return tuple(lines)
