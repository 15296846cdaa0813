"""Iteration of the scale by single shots: comparison at the estimated placement."""

from __future__ import annotations

from collections.abc import Callable

from fusion.scaling.fit.joint import ScaleEstimate, ScaleOptions, estimate_scale
from fusion.scaling.geometry.placement import LidarPlacement
from fusion.scaling.shots.shots import ShotComparison

# Each round removes three quarters or more of the remaining error.
_MOST_ROUNDS = 5


def iterate_shots(
    compared: ShotComparison,
    at: Callable[[LidarPlacement], ShotComparison],
    *,
    options: ScaleOptions | None = None,
) -> tuple[ShotComparison, ScaleEstimate]:
    """Estimate the scale and compare again at the estimated placement, until convergence.

    A single estimate underestimates rotations, by the share of noise in the slopes of the shape
    (:class:`fusion.scaling.geometry.LidarPlacement`).

    Parameters
    ----------
    compared : ShotComparison
        Comparison with zero offset and rotation.
    at : callable
        Compares the same shots at a given placement.
    options : ScaleOptions, optional

    Returns
    -------
    ShotComparison, ScaleEstimate
        Those of the last round, or of the one before if half of the shots then miss the shape.

    Raises
    ------
    NotObservableError
        If there are fewer than two observations.
    """
    estimate = estimate_scale(compared.observations, options=options)
    for _ in range(_MOST_ROUNDS):
        known = LidarPlacement.of(estimate.fit.estimate)
        again = at(known)
        if len(again.observations) < max(2.0, len(compared.observations) / 2.0):
            break
        compared, estimate = again, estimate_scale(again.observations, options=options)
        if known.agrees_with(estimate.fit.estimate, estimate.fit.sigma):
            break
    return compared, estimate
