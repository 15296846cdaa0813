"""Shots compared where the estimate puts them, until it stays."""

from __future__ import annotations

from collections.abc import Callable

from fusion.scaling.fit.joint import ScaleEstimate, ScaleOptions, estimate_scale
from fusion.scaling.geometry.placing import KnownPlace
from fusion.scaling.shots.shots import ShotComparison

# Each takes three quarters and more of what the one before has left.
_MOST_ROUNDS = 5


def settle_shots(
    compared: ShotComparison,
    at: Callable[[KnownPlace], ShotComparison],
    *,
    options: ScaleOptions | None = None,
) -> tuple[ShotComparison, ScaleEstimate]:
    """Estimate the scale, and compare again where the lidar surface lies by that, until it stays.

    One estimate falls short of a rotation, by the share that noise has in the slopes of the shape
    (:class:`fusion.scaling.geometry.KnownPlace`).

    Parameters
    ----------
    compared : ShotComparison
        As if the lidar surface lay on the SPC surface.
    at : callable
        Compares the same shots with the lidar surface where a `KnownPlace` has it.
    options : ScaleOptions, optional

    Returns
    -------
    ShotComparison, ScaleEstimate
        The last ones; those before a place where half of the shots miss the shape.

    Raises
    ------
    NotObservableError
        If there are fewer than two observations.
    """
    estimate = estimate_scale(compared.observations, options=options)
    for _ in range(_MOST_ROUNDS):
        known = KnownPlace.of(estimate.fit.estimate)
        again = at(known)
        if len(again.observations) < max(2.0, len(compared.observations) / 2.0):
            break
        compared, estimate = again, estimate_scale(again.observations, options=options)
        if known.is_told_by(estimate.fit.estimate, estimate.fit.sigma):
            break
    return compared, estimate
