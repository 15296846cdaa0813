"""ε of single days, and its dependence on longitude and local time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.estimation import ErrorSizes, MixedFit, MixedOptions, Observations, fit_mixed
from fusion.scaling.fit.groups import ErrorGroups
from fusion.scaling.fit.observation import ScaleObservations
from spcola.arrays import BoolArray, FloatArray
from spcola.math.statistics import chi_square_tail


@dataclass(frozen=True)
class Trend:
    """A dependence of ε on an angle with period 2π: ε = a cos φ + b sin φ.

    `amplitude` and `sigma` are dimensionless; `p_value` is that of the amplitude without a
    dependence; `phase_rad` is the angle of the largest ε.
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
        Mean weighted by the full covariance, with shared errors of states and ground, and its
        sigma.
    mean, standard_error : float
        Plain mean of the single ε and its standard error from their scatter, as published (Gaskell
        et al. §6.2), which assumes independence; NaN from one observation.
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


def days_differ(
    observations: ScaleObservations, fit: MixedFit, groups: ErrorGroups, *, expected_m: float
) -> float:
    """p-value of the differences of ranges between single days, given the errors fitted.

    Parameters
    ----------
    observations : ScaleObservations
    fit : MixedFit
        Fit to them.
    groups : ErrorGroups
    expected_m : float
        Standard deviation of the shared range error of a day, metres.

    Returns
    -------
    float
        p-value of χ² with number of days − 1 degrees of freedom; 1 for one day.
    """
    days = np.array(observations.day)
    known = sorted(set(days[fit.used]))
    if len(known) < 2:
        return 1.0
    member = (days[:, None] == np.array(known)[None, :]).astype(np.float64)
    own = _fit_epsilon(observations, fit, groups, fit.used, member, first_known=0)
    # A range error changes the ε of a day by its ratio to ∂range/∂ε.
    gain = np.abs(observations.range_per_epsilon)
    shift = np.array([expected_m / float(np.mean(gain[(days == d) & fit.used])) for d in known])
    weight = np.linalg.inv(own.covariance + np.diag(shift**2))
    off = own.estimate - weight.sum(axis=0) @ own.estimate / weight.sum()
    return chi_square_tail(float(off @ weight @ off), len(known) - 1)


def _fit_epsilon(
    observations: ScaleObservations,
    fit: MixedFit,
    groups: ErrorGroups,
    chosen: BoolArray,
    design: FloatArray,
    *,
    first_known: int = 4,
) -> MixedFit:
    """Fit `design` (N, P) to the ε of the `chosen` observations, with the error sizes of `fit`.

    Parameters of the joint estimate from index `first_known` on are subtracted first.

    Raises
    ------
    NotObservableError
        If they do not determine a column of the design.
    """
    gain = observations.range_per_epsilon
    # Rotation and range bias are those of the joint estimate; an offset of the centre is not, as a
    # dependence on longitude may be such an offset.
    known = observations.design()[:, :, first_known:] @ fit.estimate[first_known:]
    residual = observations.in_range(observations.value - known)
    variance = (observations.range_variance + fit.sizes.independent**2) / np.maximum(
        fit.weight, 1e-12
    )
    states, days, ground = fit.sizes.shared
    # The shared error of a single day is not separable from its ε, and not part of its sigma.
    several = len(set(np.array(observations.day)[chosen])) > 1 and first_known > 0
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
            names=tuple(f"term {number}" for number in range(design.shape[1])),
            robust=False,
        ),
    )


def trends(observations: ScaleObservations, fit: MixedFit, groups: ErrorGroups) -> dict[str, Trend]:
    """Dependence of the single ε on longitude and on local time."""
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
    """Fit mean + a cos + b sin; None if the range of angles does not determine them."""
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
        chi_square_tail(chi_square, 2),
    )
