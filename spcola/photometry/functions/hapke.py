"""Hapke's reflectance, smooth and with macroscopic roughness: compiled scalars with derivatives.

Hapke (1981, J. Geophys. Res. 86, 3039) with the opposition term and his H functions
``H(x) = (1 + 2x) / (1 + 2 x √(1 − w))``; roughness as in Hapke (1984, Icarus 59, 41). Numbers with
derivatives by μ0 and μ are tuples (value, by μ0, by μ). Terms are as in
:mod:`spcola.photometry.functions.disks`.
"""

from __future__ import annotations

import numpy as np

from spcola.compilation import compiled
from spcola.photometry.functions.disks import Shade, Terms

# The azimuth between the planes of incidence and emission has no derivative where these coincide.
_LEAST_SINE = 1e-6
# Cosines nearer to 1 than this are as 1: their angle has an infinite derivative.
_MOST_COSINE = 1.0 - 1e-12


@compiled
def hapke_h(x: float, gamma: float) -> tuple[float, float]:
    """Return H(x) and its derivative; `gamma` is √(1 − w)."""
    below = 1.0 + 2.0 * x * gamma
    return (1.0 + 2.0 * x) / below, 2.0 * (1.0 - gamma) / below**2


@compiled
def hapke(terms: Terms, incidence: float, emission: float) -> Shade:
    """``f μ0 / (μ0 + μ) (p + H(μ0) H(μ) − 1)``; terms: f, p = (1 + B) P, √(1 − w)."""
    first, by_first = hapke_h(incidence, terms[2])
    second, by_second = hapke_h(emission, terms[2])
    both = incidence + emission
    scattered = terms[1] + first * second - 1.0
    lunar = terms[0] / both
    return (
        lunar * incidence * scattered,
        lunar * (emission / both * scattered + incidence * by_first * second),
        lunar * incidence * (first * by_second - scattered / both),
    )


@compiled
def _times(a: Shade, b: Shade) -> Shade:
    return a[0] * b[0], a[1] * b[0] + a[0] * b[1], a[2] * b[0] + a[0] * b[2]


@compiled
def _over(a: Shade, b: Shade) -> Shade:
    ratio = a[0] / b[0]
    return ratio, (a[1] - ratio * b[1]) / b[0], (a[2] - ratio * b[2]) / b[0]


@compiled
def _sum(a: Shade, b: Shade, factor: float) -> Shade:
    """Return ``a + factor · b``."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@compiled
def _tilts(terms: Terms, cosine: float, sine: float) -> tuple[float, float, float, float]:
    """Return E1, E2 of an angle and their derivatives by its cosine; terms 4 and 5 as below."""
    cotangent = cosine / sine
    first = np.exp(-terms[4] * cotangent)
    second = np.exp(-terms[5] * cotangent**2)
    rise = 1.0 / sine**3
    return first, second, -terms[4] * first * rise, -2.0 * terms[5] * cotangent * second * rise


@compiled
def _azimuth(cos_phase: float, incidence: float, emission: float) -> tuple[Shade, Shade]:
    """Return ψ between the planes of incidence and emission, and cos ψ, with derivatives."""
    sine_i, sine_e = np.sqrt(1.0 - incidence**2), np.sqrt(1.0 - emission**2)
    product = sine_i * sine_e
    # Not beyond 1 by rounding.
    cosine = min(max((cos_phase - incidence * emission) / product, -1.0), 1.0)
    by_i = -emission / product + cosine * incidence / sine_i**2
    by_e = -incidence / product + cosine * emission / sine_e**2
    sine = max(np.sqrt(1.0 - cosine**2), _LEAST_SINE)
    return (np.arccos(cosine), -by_i / sine, -by_e / sine), (cosine, by_i, by_e)


@compiled
def rough_hapke(terms: Terms, incidence: float, emission: float) -> Shade:
    """Return the rough surface's brightness: effective cosines, times Hapke's S.

    Terms: f, p, √(1 − w), tan θ̄, (2/π) cot θ̄, cot² θ̄ / π, χ(θ̄), and the real cos α.
    """
    incidence, emission = min(incidence, _MOST_COSINE), min(emission, _MOST_COSINE)
    zero = 0.0 * terms[0]
    chi, tangent = terms[6], terms[3]
    psi, cos_psi = _azimuth(terms[7].real, incidence, emission)
    half = (0.5 - 0.5 * cos_psi[0], -0.5 * cos_psi[1], -0.5 * cos_psi[2])
    sine_i, sine_e = np.sqrt(1.0 - incidence**2), np.sqrt(1.0 - emission**2)
    tilt_i, tilt_e = _tilts(terms, incidence, sine_i), _tilts(terms, emission, sine_e)
    e1_i, e2_i = (tilt_i[0], tilt_i[2], zero), (tilt_i[1], tilt_i[3], zero)
    e1_e, e2_e = (tilt_e[0], zero, tilt_e[2]), (tilt_e[1], zero, tilt_e[3])
    mu_0, mu = (incidence + zero, 1.0 + zero, zero), (emission + zero, zero, 1.0 + zero)
    one = (1.0 + zero, zero, zero)
    rough_i = (tangent * sine_i, -tangent * incidence / sine_i, zero)
    rough_e = (tangent * sine_e, zero, -tangent * emission / sine_e)
    # The face that is seen at the larger angle shadows or hides the other.
    light_lower = incidence >= emission
    e1_near, e2_near = (e1_i, e2_i) if light_lower else (e1_e, e2_e)
    e1_far, e2_far = (e1_e, e2_e) if light_lower else (e1_i, e2_i)
    share = (psi[0] / np.pi, psi[1] / np.pi, psi[2] / np.pi)
    below = _sum(_sum((2.0 + zero, zero, zero), e1_far, -1.0), _times(share, e1_near), -1.0)
    hidden = _over(_sum(e2_far, _times(half, e2_near), -1.0), below)
    turned = _over(_sum(_times(cos_psi, e2_far), _times(half, e2_near), 1.0), below)
    lift_0, lift = (turned, hidden) if light_lower else (hidden, turned)
    eff_0, eff = _sum(mu_0, _times(rough_i, lift_0), 1.0), _sum(mu, _times(rough_e, lift), 1.0)
    # η(x) / χ, of an angle seen by itself.
    two = (2.0 + zero, zero, zero)
    eta_0 = _sum(mu_0, _times(rough_i, _over(e2_i, _sum(two, e1_i, -1.0))), 1.0)
    eta = _sum(mu, _times(rough_e, _over(e2_e, _sum(two, e1_e, -1.0))), 1.0)
    faced_0, faced = _over(mu_0, eta_0), _over(eff, eta)
    nearer = faced_0 if light_lower else _over(mu, eta)
    # exp(−2 tan(ψ / 2)): 0 at ψ = π.
    tan_half = np.tan(0.5 * min(psi[0], np.pi - _LEAST_SINE))
    veil = np.exp(-2.0 * tan_half)
    slope = -veil * (1.0 + tan_half**2)
    f = (veil + zero, slope * psi[1] + zero, slope * psi[2] + zero)
    # S = (μe / η(e)) (μ0 / η(i)) χ / (1 − f + f χ μ / η), μ / η of the smaller angle; χ is in η.
    lit = _sum(_sum(one, f, -1.0), _times(f, nearer), 1.0)
    shadow = _over(_times(faced, faced_0), lit)
    x_0 = (chi * eff_0[0], chi * eff_0[1], chi * eff_0[2])
    x = (chi * eff[0], chi * eff[1], chi * eff[2])
    inner = hapke(terms, x_0[0], x[0])
    smooth = (
        inner[0],
        inner[1] * x_0[1] + inner[2] * x[1],
        inner[1] * x_0[2] + inner[2] * x[2],
    )
    return _times(smooth, shadow)
