"""The joint estimate of scale, offset of the centre, rotation and range bias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from fusion.mixed import ErrorSizes, MixedFit, MixedOptions, Observations, fit_mixed
from fusion.scaling.observation import PARAMETERS, ScaleObservations
from spcola.arrays import BoolArray, FloatArray
from spcola.errors import NotObservableError

# A parameter whose sigma is still this share of its prior was not determined by the data.
_LEARNT = 0.7
# Correlation beyond which two parameters are said to be inseparable.
_INSEPARABLE = 0.95


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
    day_sigma_m : float
        Prior median of the error that a day's observations share, metres; estimated. 0: none.
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


@dataclass(frozen=True)
class Trend:
    """A once-around dependence of ε on an angle: ε = a cos φ + b sin φ.

    `amplitude` and `sigma` are dimensionless; `p_value` is the chance of such an amplitude where
    there is no dependence; `phase_rad` is the angle of the largest ε.
    """

    amplitude: float
    sigma: float
    phase_rad: float
    p_value: float


@dataclass(frozen=True)
class DayScale:
    """ε of one day: mean of its observations weighted by their covariance, and its sigma."""

    day: str
    count: int
    epsilon: float
    epsilon_sigma: float


@dataclass(frozen=True, eq=False)
class ScaleEstimate:
    """The joint estimate.

    Attributes
    ----------
    fit : MixedFit
        Parameters in the order of :data:`PARAMETERS`, covariance, residuals, weights.
    days : tuple of DayScale
    trends : dict of str to Trend
        "longitude" and, where the Sun is known, "local_time".
    reasons : tuple of str
        Which terms the data do not determine, or not separately, and why.
    """

    fit: MixedFit
    days: tuple[DayScale, ...]
    trends: dict[str, Trend]
    reasons: tuple[str, ...]

    @property
    def epsilon(self) -> float:
        """All SPC lengths are to be multiplied by 1 + ε."""
        return float(self.fit.estimate[0])

    @property
    def epsilon_sigma(self) -> float:
        """One standard deviation of ε."""
        return float(self.fit.sigma[0])


def estimate_scale(
    observations: ScaleObservations, *, options: ScaleOptions | None = None
) -> ScaleEstimate:
    """Estimate ε with all that could be mistaken for it, robustly (docs: mathematics §17).

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
    days = sorted(set(observations.day))
    member = np.array([[day == other for other in days] for day in observations.day], dtype=float)
    mixed = MixedOptions(
        prior=options.prior,
        sizes=ErrorSizes(
            options.single_sigma_m,
            (
                options.state_sigma_m if observations.leant_on.shape[1] > 1 else 0.0,
                options.day_sigma_m if len(days) > 1 else 0.0,
            ),
        ),
        scale=options.prior,
        names=PARAMETERS,
        reject=options.reject,
    )
    fit = fit_mixed(
        Observations(
            observations.value,
            observations.design(),
            observations.covariance,
            (_effects(observations.leant_on, observations), _effects(member, observations)),
        ),
        mixed,
    )
    reasons = _reasons(fit, options, observations, len(days))
    return ScaleEstimate(fit, _by_day(observations, fit, days), _trends(observations, fit), reasons)


def _effects(shares: FloatArray, observations: ScaleObservations) -> FloatArray:
    """How displacements (3,) of S sources enter the observations (N, D, 3 S).

    A pair sees all three components, a shot what they change of its range.
    """
    count = len(shares)
    seen: FloatArray = np.broadcast_to(np.eye(3), (count, 3, 3))
    if observations.kind == "shots":
        seen = observations.along_range[:, None, :]
    return np.einsum("ns,ndi->ndsi", shares, seen).reshape(count, seen.shape[1], -1)


def _by_day(
    observations: ScaleObservations, fit: MixedFit, days: list[str]
) -> tuple[DayScale, ...]:
    """Mean ε of each day from the observations that were not rejected, with its standard error.

    Observations that lean on one state count as what they are together, not as many.
    """
    day = np.array(observations.day)
    rows = []
    for name in days:
        chosen = (day == name) & fit.used
        if not chosen.any():
            continue
        mean = _fit_epsilon(observations, fit, chosen, np.ones((len(day), 1)))
        rows.append(
            DayScale(name, int(chosen.sum()), float(mean.estimate[0]), float(mean.sigma[0]))
        )
    return tuple(rows)


def _fit_epsilon(
    observations: ScaleObservations, fit: MixedFit, chosen: BoolArray, design: FloatArray
) -> MixedFit:
    """Fit `design` (N, P) to the ε of the `chosen` observations, with the error sizes of `fit`.

    Raises
    ------
    NotObservableError
        If they leave a column of the design free.
    """
    gain = observations.range_per_epsilon
    # Rotation and range bias are known from the joint estimate; an offset of the centre is what
    # a dependence on longitude may be.
    known = observations.design()[:, :, 4:] @ fit.estimate[4:]
    residual = observations.in_range(observations.value - known)
    variance = (observations.range_variance + fit.sizes.independent**2) / np.maximum(
        fit.weight, 1e-12
    )
    days = sorted(set(np.array(observations.day)[chosen]))
    member = np.array([[day == name for name in days] for day in observations.day], dtype=float)
    groups = [(observations.leant_on, fit.sizes.shared[0]), (member, fit.sizes.shared[1])]
    # One day cannot be told from its mean; its own error stays out of its standard error.
    groups = groups if len(days) > 1 else groups[:1]
    effects = [
        np.einsum("ns,ni->nsi", shares, observations.sight).reshape(len(shares), 1, -1)
        for shares, _ in groups
    ]
    return fit_mixed(
        Observations(
            residual[chosen, None],
            (design * gain[:, None])[chosen, None, :],
            variance[chosen, None, None],
            tuple(group[chosen] for group in effects),
        ),
        MixedOptions(
            prior=np.full(design.shape[1], np.inf),
            sizes=ErrorSizes(0.0, tuple(size for _, size in groups), width=0.0),
            scale=np.full(design.shape[1], 1.0 / float(np.mean(np.abs(gain)))),
            names=("mean", "cosine", "sine")[: design.shape[1]],
            robust=False,
        ),
    )


def _trends(observations: ScaleObservations, fit: MixedFit) -> dict[str, Trend]:
    """Dependence of ε, as each observation gives it, on longitude and on local time."""
    angles = {"longitude": observations.longitude}
    if np.isfinite(observations.local_time_h).all():
        angles["local_time"] = observations.local_time_h * (np.pi / 12.0)
    found = {}
    for name, angle in angles.items():
        trend = _once_around(observations, fit, angle)
        if trend is not None:
            found[name] = trend
    return found


def _once_around(observations: ScaleObservations, fit: MixedFit, angle: FloatArray) -> Trend | None:
    """Fit mean + a cos + b sin; None where the angles do not spread enough to tell."""
    design = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    used = design[fit.used]
    if len(used) < 5 or np.linalg.cond(used.T @ used) > 1e4:
        return None
    wave = _fit_epsilon(observations, fit, fit.used, design)
    part, spread = wave.estimate[1:], wave.covariance[1:, 1:]
    amplitude = float(np.hypot(*part))
    toward = part / amplitude if amplitude > 0 else np.array([1.0, 0.0])
    chi_square = float(part @ np.linalg.solve(spread, part))
    return Trend(
        amplitude,
        float(np.sqrt(toward @ spread @ toward)),
        float(np.arctan2(part[1], part[0])),
        float(stats.chi2.sf(chi_square, 2)),
    )


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
