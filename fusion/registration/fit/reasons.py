"""Texts about parameters that a registration determines weakly."""

from __future__ import annotations

import numpy as np

from fusion.registration.fit.fit import Registration
from fusion.registration.fit.stability import REGIONS, region_numbers
from spcola.arrays import FloatArray

# A larger correlation makes sigmas more than three times those with the other parameter fixed.
_INSEPARABLE = 0.95
# Beyond a tenth of a radian rotations are not small: second order is 5 % of first order.
_SMALL = 0.1
# Mapolas in no more than this share of the regions cover one side of the body only.
_ONE_SIDE = 0.25


def registration_reasons(registration: Registration) -> list[str]:
    """Name the parameters that are weakly determined, and those that are not separable.

    A parameter is weakly determined if its sigma displaces the mapolas by more than the sigma of a
    single mapola: one mapola alone would determine it better if the other parameters were known.

    Returns
    -------
    list of str
        Empty if all parameters are well determined.
    """
    used = registration.centers[registration.fit.used]
    return [
        *_coverage(used),
        *_weak(registration, used),
        *inseparable(registration.parameters, registration.covariance),
    ]


def _coverage(used: FloatArray) -> list[str]:
    """Report that the mapolas cover one side of the body only."""
    covered = len(np.unique(region_numbers(used)))
    if covered > _ONE_SIDE * REGIONS:
        return []
    return [
        f"mapolas: in {covered} of {REGIONS} equal regions of the body only; the transform is an "
        "extrapolation elsewhere"
    ]


def _weak(registration: Registration, used: FloatArray) -> list[str]:
    """Report the parameters whose sigma exceeds that of one mapola."""
    single = _single_sigma(registration)
    lever = float(np.sqrt(np.mean(np.sum(used**2, axis=1))))
    texts = []
    for name, sigma in zip(
        registration.parameters, np.sqrt(np.diag(registration.covariance)), strict=True
    ):
        moved = sigma if name.endswith("_m") else sigma * lever
        if moved <= single:
            continue
        text = f"{name}: weakly determined: its sigma of {_sized(name, sigma)}"
        text += "" if name.endswith("_m") else f" moves mapolas by {moved:.2g} m, which"
        text += f" is more than the sigma of one mapola, {single:.2g} m"
        if name.endswith("_rad") and sigma > _SMALL:
            text += "; so large a rotation is beyond linearisation, and not determined at all"
        texts.append(text)
    return texts


def _single_sigma(registration: Registration) -> float:
    """Median sigma, metres, of one mapola along the axis in which its match is most accurate.

    This is often the height, with a poorly determined horizontal position.
    """
    fit, observations = registration.fit, registration.observations
    best = np.linalg.eigvalsh(observations.covariance[fit.used])[:, 0]
    shared = sum(
        size**2 * float(np.sum(group[fit.used] ** 2)) / (3.0 * np.count_nonzero(fit.used))
        for size, group in zip(fit.sizes.shared, observations.effects, strict=True)
    )
    return float(np.sqrt(np.median(best) + fit.sizes.independent**2 + shared))


def _sized(name: str, sigma: float) -> str:
    """Return a sigma with its unit."""
    if name.endswith("_m"):
        return f"{sigma:.2g} m"
    return f"{np.degrees(sigma):.2g} deg" if name.endswith("_rad") else f"{sigma:.2g}"


def inseparable(names: tuple[str, ...], covariance: FloatArray) -> list[str]:
    """Name the pairs of parameters whose estimates are correlated beyond 0.95."""
    sigma = np.sqrt(np.diag(covariance))
    product = np.outer(sigma, sigma)
    correlation = np.divide(covariance, product, out=np.zeros_like(covariance), where=product > 0)
    pairs = [
        f"{names[i]} and {names[j]} ({correlation[i, j]:+.3f})"
        for i, j in np.argwhere(np.triu(np.abs(correlation) > _INSEPARABLE, 1)).tolist()
    ]
    if not pairs:
        return []
    return [f"not separable, which their sigmas include: {', '.join(pairs)}"]
