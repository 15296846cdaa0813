"""The joint estimate of scale, offset of the centre, rotation and range bias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.estimation import ErrorSizes, MixedFit, MixedOptions, Observations, fit_mixed
from fusion.scaling.fit.ground import SharedGround, shared_ground
from fusion.scaling.fit.groups import ErrorGroups
from fusion.scaling.fit.observation import PARAMETERS, ScaleObservations
from fusion.scaling.fit.trends import DayScale, Trend, by_day, days_differ, trends
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError

# A parameter whose sigma exceeds this share of its prior is not determined by the data.
_DETERMINED = 0.7
# Correlation beyond which two parameters are not separable.
_INSEPARABLE = 0.95
# Factor on the expected range errors of days in the test of their agreement: the expectation is a
# median.
_DAYS = 2.0
# The first fit attributes errors of the ground partly to days and states; the second one gives a
# better estimate of their correlation length.
_GROUND_ROUNDS = 2


@dataclass(frozen=True)
class ScaleOptions:
    """Priors and error sizes of the joint estimate.

    A prior is a standard deviation about 0; it is the resulting sigma of a parameter that the data
    do not determine.

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
        Prior median of the independent error of one observation in addition to its own covariance,
        metres (of its maplets; of the resolution of the shape); estimated.
    state_sigma_m : float
        Prior median of the error of an image's state (or of a scan's trajectory), metres, per
        axis; estimated. 0: none.
    scan_sigma_m : float
        Pointing error of a scan on the ground, metres, on each axis across the beam, if image
        states locate its returns. 0: none.
    day_sigma_m : float
        Prior median of the shared error of the ranges of a day, metres; estimated. 0: none.
    reject : float
        Observations with residuals of more than this many standard deviations are rejected.
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
        """Prior sigmas (8,) in the order of :data:`PARAMETERS`, SI units."""
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
        Observations of the fit.
    days : tuple of DayScale
    trends : dict of str to Trend
        "longitude" and, if the Sun is known, "local_time".
    reasons : tuple of str
        Terms that the data do not determine or do not separate, and why.
    ground : SharedGround or None
        Shared errors of single shots on the same ground.
    days_p_value : float
        p-value of the differences of ranges between single days.
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
        """Parameters that the data do not separate from ε, and their correlations with it."""
        return _inseparable(self.fit)

    def undetermined(self, options: ScaleOptions) -> tuple[str, ...]:
        """Parameters that are determined by the priors of `options`, not by the data."""
        loose = self.fit.sigma > _DETERMINED * options.prior
        return tuple(name for name, left in zip(PARAMETERS, loose, strict=True) if left)

    @property
    def epsilon(self) -> float:
        """Scale error: SPC lengths times 1 + ε are correct; above 0 the SPC body is too small."""
        return float(self.fit.estimate[0])

    @property
    def epsilon_sigma(self) -> float:
        """One standard deviation of ε."""
        return float(self.fit.sigma[0])


def estimate_scale(
    observations: ScaleObservations, *, options: ScaleOptions | None = None
) -> ScaleEstimate:
    """Estimate ε jointly with all correlated parameters, robustly (docs: derivations §17).

    Parameters
    ----------
    observations : ScaleObservations
    options : ScaleOptions, optional

    Returns
    -------
    ScaleEstimate
        Terms that the data do not determine are named in its `reasons`; no error is raised.

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
        ground, observations = found, found.added_to(alone)
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
        groups.as_observed(observations),
    )
    return groups, equations, fit_mixed(equations, mixed)


def _inseparable(fit: MixedFit) -> tuple[tuple[str, float], ...]:
    """Parameters that the data do not separate from ε, and their correlations with it."""
    correlation = fit.covariance[0] / (fit.sigma[0] * fit.sigma)
    return tuple(
        (name, float(value))
        for name, value in zip(PARAMETERS[1:], correlation[1:], strict=True)
        if abs(value) > _INSEPARABLE
    )


def _reasons(
    fit: MixedFit, options: ScaleOptions, observations: ScaleObservations, days: int
) -> tuple[str, ...]:
    """Report terms that the data do not determine, and terms that they do not separate."""
    sigma, lines = fit.sigma, []
    for name, spread, prior in zip(PARAMETERS, sigma, options.prior, strict=True):
        if spread > _DETERMINED * prior:
            lines.append(
                f"{name}: not determined by the data; its sigma {spread:.3g} is that of the prior "
                f"({prior:.3g})"
            )
    lines += [
        f"epsilon and {name} are not separable (correlation {correlation:+.3f}); the sigma of "
        "epsilon includes this"
        for name, correlation in _inseparable(fit)
    ]
    if days == 1:
        lines.append("per-day terms: all observations are of one day")
    spread_of_range = float(np.ptp(observations.range) / np.mean(observations.range))
    if spread_of_range < 0.05 and observations.trajectory == "spc":
        lines.append(
            f"range_bias_m: the ranges vary by {spread_of_range:.1%} only, so a constant bias "
            "looks like a scale"
        )
    return tuple(lines)
