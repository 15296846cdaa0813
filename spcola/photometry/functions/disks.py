"""Brightness over the disk at a given phase: compiled scalars with both derivatives.

Each takes the terms that depend on the phase alone (:mod:`spcola.photometry.functions.kernel`) and
the cosines μ0, μ > 0 of incidence and emission, and returns the value and its derivatives by μ0 and
by μ. Cosines are real; terms may be complex, so that a complex step in a parameter gives its exact
derivative. What decides a branch or an angle is the real part.
"""

from __future__ import annotations

import numpy as np

from spcola.compilation import compiled

Terms = tuple[float, float, float, float, float, float, float, float]
Shade = tuple[float, float, float]


@compiled
def lambert(terms: Terms, incidence: float, emission: float) -> Shade:
    """``f μ0``; terms: f."""
    return terms[0] * incidence, terms[0] + 0.0 * emission, 0.0 * terms[0]


@compiled
def lunar_lambert(terms: Terms, incidence: float, emission: float) -> Shade:
    """``f (2 L μ0 / (μ0 + μ) + (1 − L) μ0)``; terms: f, L. Lommel–Seeliger for L = 1."""
    whole, weight = terms[0], terms[1]
    both = incidence + emission
    lunar = weight * (2.0 * incidence / both)
    steep = 2.0 * weight / both**2
    return (
        whole * (lunar + (1.0 - weight) * incidence),
        whole * (steep * emission + 1.0 - weight),
        -whole * (steep * incidence),
    )


@compiled
def minnaert(terms: Terms, incidence: float, emission: float) -> Shade:
    """``f μ0^k μ^(k − 1)``; terms: f, k."""
    power = terms[1]
    value = terms[0] * np.exp(power * np.log(incidence) + (power - 1.0) * np.log(emission))
    return value, value * power / incidence, value * (power - 1.0) / emission


@compiled
def akimov(terms: Terms, incidence: float, emission: float) -> Shade:
    """``f cos(κ (γ − α/2)) cos(β)^q / μ``, γ and β photometric longitude and latitude.

    With x = cos β cos γ = μ and y = cos β sin γ = (μ0 − μ cos α) / sin α. Terms: f, q, and the real
    κ = π / (π − α), α / 2, cos α, 1 / sin α.
    """
    power, stretch, half = terms[1], terms[2].real, terms[3].real
    across = terms[5].real
    y = (incidence - emission * terms[4].real) * across
    square = emission**2 + y**2
    turned = stretch * (np.arctan2(y, emission) - half)
    scale = terms[0] * np.exp(0.5 * power * np.log(square)) / emission
    value = scale * np.cos(turned)
    sine, rise = scale * np.sin(turned) * stretch / square, value * power / square
    by_y = rise * y - sine * emission
    by_x = rise * emission + sine * y - value / emission
    return value, by_y * across, by_x - by_y * terms[4].real * across
