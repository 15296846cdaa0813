"""ε of single days, and its dependence on longitude and local time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from fusion.errorsizes import ErrorSizes
from fusion.mixed import MixedFit, MixedOptions, Observations, fit_mixed
from fusion.scaling.groups import ErrorGroups
from fusion.scaling.observation import ScaleObservations
from spcola.arrays import BoolArray, FloatArray


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
    """ε of one day.

    Attributes
    ----------
    day : str
    count : int
        Observations that were not rejected.
    epsilon, epsilon_sigma : float
        Mean of them weighted by their covariance, and its sigma: what leans on one state, or lies
        on one ground, counts as what it is together.
    mean, standard_error : float
        Plain mean of what each says alone and its standard error from their scatter, as it is
        published (Gaskell et al. §6.2): as if all were independent; NaN from one observation.
    """

    day: str
    count: int
    epsilon: float
    epsilon_sigma: float
    mean: float
    standard_error: float


def by_day(
    observations: ScaleObservations, fit: MixedFit, groups: ErrorGroups
) -> tuple[DayScale, ...]:
    """ε of each day from the observations that were not rejected, with its sigma."""
    day = np.array(observations.day)
    single, _ = observations.epsilon()
    rows = []
    for name in sorted(set(observations.day)):
        chosen = (day == name) & fit.used
        if not (count := int(chosen.sum())):
            continue
        own = _fit_epsilon(observations, fit, groups, chosen, np.ones((len(day), 1)))
        error = float(np.std(single[chosen], ddof=1) / np.sqrt(count)) if count > 1 else np.nan
        rows.append(
            DayScale(
                name,
                count,
                float(own.estimate[0]),
                float(own.sigma[0]),
                float(np.mean(single[chosen])),
                error,
            )
        )
    return tuple(rows)


def _fit_epsilon(
    observations: ScaleObservations,
    fit: MixedFit,
    groups: ErrorGroups,
    chosen: BoolArray,
    design: FloatArray,
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
    states, days, ground = fit.sizes.shared
    # One day cannot be told from its mean; its own error stays out of its standard error.
    several = len(set(np.array(observations.day)[chosen])) > 1
    return fit_mixed(
        Observations(
            residual[chosen, None],
            (design * gain[:, None])[chosen, None, :],
            variance[chosen, None, None],
            tuple(group[chosen] for group in groups.in_range(observations)),
        ),
        MixedOptions(
            prior=np.full(design.shape[1], np.inf),
            sizes=ErrorSizes(0.0, (states, days if several else 0.0, ground), width=0.0),
            scale=np.full(design.shape[1], 1.0 / float(np.mean(np.abs(gain)))),
            names=("mean", "cosine", "sine")[: design.shape[1]],
            robust=False,
        ),
    )


def trends(observations: ScaleObservations, fit: MixedFit, groups: ErrorGroups) -> dict[str, Trend]:
    """Dependence of ε, as each observation gives it, on longitude and on local time."""
    angles = {"longitude": observations.longitude}
    if np.isfinite(observations.local_time_h).all():
        angles["local_time"] = observations.local_time_h * (np.pi / 12.0)
    found = {}
    for name, angle in angles.items():
        trend = _once_around(observations, fit, groups, angle)
        if trend is not None:
            found[name] = trend
    return found


def _once_around(
    observations: ScaleObservations, fit: MixedFit, groups: ErrorGroups, angle: FloatArray
) -> Trend | None:
    """Fit mean + a cos + b sin; None where the angles do not spread enough to tell."""
    design = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    used = design[fit.used]
    if len(used) < 5 or np.linalg.cond(used.T @ used) > 1e4:
        return None
    wave = _fit_epsilon(observations, fit, groups, fit.used, design)
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
