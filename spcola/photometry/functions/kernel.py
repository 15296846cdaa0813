"""The compiled choice of a photometric function by its code: what kernels of photoclinometry call.

``shade(code, parameters, cos_incidence, cos_emission, phase)`` is the whole function. It is
``shade_at(code, phase_terms(code, parameters, phase), cos_incidence, cos_emission)``: a kernel that
takes the phase angle of an image as constant over a maplet computes the terms once and calls
`shade_at` for each point. Neither allocates; both are compiled into the kernel, as handing on so
many numbers would take longer than most formulas. `parameters` are eight float64 numbers
(:attr:`spcola.photometry.functions.PhotometricFunction.packed`); complex ones give the derivatives
by parameters (complex step).
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline
from spcola.photometry.functions.disks import (
    Shade,
    Terms,
    akimov,
    lambert,
    lunar_lambert,
    minnaert,
)
from spcola.photometry.functions.hapke import hapke, hapke_h, rough_hapke

PACKED = 8
"""Length of the array of parameters of every function."""


class Code(IntEnum):
    """Codes of the formulas; what their parameters are is in `phase_terms`."""

    LAMBERT = 0
    LOMMEL_SEELIGER = 1
    LOMMEL_SEELIGER_POLYNOMIAL = 2
    MCEWEN = 3
    LUNAR_EXPONENTIAL = 4
    MINNAERT = 5
    AKIMOV = 6
    HAPKE = 7
    HAPKE_ROUGH = 8


# Numba takes plain integers as constants.
_LAMBERT, _LOMMEL, _POLYNOMIAL, _MCEWEN, _LUNAR, _MINNAERT, _AKIMOV, _HAPKE, _ROUGH = map(int, Code)
# Below it, and so near to half a turn, phase angles are as these limits (radians): Akimov's
# longitude is undetermined at 0, his stretch at π.
_LEAST_PHASE, _LEAST_REST = 1e-6, 1e-3
# The least roughness, radians: its cotangent is finite.
_LEAST_TILT = 1e-6
_STEP = 1e-30


@compiled_inline
def phase_terms(  # noqa: PLR0911  a choice
    code: int, parameters: AnyArray, phase: float
) -> Terms:
    """Return the terms of a function that depend on the phase angle alone.

    Parameters
    ----------
    code : int
        :attr:`spcola.photometry.functions.PhotometricFunction.code`.
    parameters : (8,) ndarray
        Its :attr:`~spcola.photometry.functions.PhotometricFunction.packed`.
    phase : float
        Radians.

    Returns
    -------
    tuple of eight float
    """
    p = parameters
    zero = 0.0 * p[0]
    one = 1.0 + zero
    degrees = np.degrees(phase)
    cubic = degrees * (p[0] + degrees * (p[1] + degrees * p[2]))
    if code == _LOMMEL:
        return np.exp(cubic), one, zero, zero, zero, zero, zero, zero
    if code == _POLYNOMIAL:
        # A polynomial that falls below 0 is no brightness.
        bright = one + cubic if 1.0 + cubic.real > 0.0 else zero
        return bright, one, zero, zero, zero, zero, zero, zero
    if code == _MCEWEN:
        weight = one + cubic
        if weight.real <= 0.0:
            weight = zero
        elif weight.real > 1.0:
            weight = one
        return one, weight, zero, zero, zero, zero, zero, zero
    if code == _LUNAR:
        return one, np.exp(-degrees / p[0]), zero, zero, zero, zero, zero, zero
    if code == _MINNAERT:
        return one, p[0] + p[1] * degrees, zero, zero, zero, zero, zero, zero
    if code == _AKIMOV:
        return _akimov_terms(p, phase)
    if code in (_HAPKE, _ROUGH):
        return _hapke_terms(p, phase)
    return one, zero, zero, zero, zero, zero, zero, zero


@compiled
def _akimov_terms(p: AnyArray, phase: float) -> Terms:
    """Parameters: η of the latitude, slope per degree of the exponential phase function."""
    zero = 0.0 * p[0]
    alpha = min(max(phase, _LEAST_PHASE), np.pi - _LEAST_REST)
    rest = np.pi - alpha
    whole = np.cos(0.5 * alpha) * np.exp(p[1] * np.degrees(phase))
    power = p[0] * alpha / rest + 1.0
    return (
        whole, power, np.pi / rest + zero, 0.5 * alpha + zero,
        np.cos(alpha) + zero, 1.0 / np.sin(alpha) + zero, zero, zero,
    )  # fmt: skip


@compiled
def _lobes(b: float, c: float, cos_phase: float) -> float:
    """Henyey–Greenstein: (1 + c)/2 of the backward lobe, (1 − c)/2 of the forward one; 0 ≤ b < 1.

    With c = −1 and b = ξ it is the single lobe of asymmetry ξ, backward where ξ < 0.
    """
    square = 1.0 + b * b
    back = np.exp(-1.5 * np.log(square - 2.0 * b * cos_phase))
    forward = np.exp(-1.5 * np.log(square + 2.0 * b * cos_phase))
    return 0.5 * (1.0 - b * b) * ((1.0 + c) * back + (1.0 - c) * forward)


@compiled
def _hapke_terms(p: AnyArray, phase: float) -> Terms:
    """Parameters: w, B0, h, b, c, θ̄ in degrees (0 where smooth)."""
    zero = 0.0 * p[0]
    gamma = np.sqrt(1.0 - p[0])
    cos_phase = np.cos(phase)
    scattered = (1.0 + p[1] / (1.0 + np.tan(0.5 * phase) / p[2])) * _lobes(p[3], p[4], cos_phase)
    tilt = np.radians(p[5].real)
    tangent = np.tan(p[5] * (np.pi / 180.0) + max(_LEAST_TILT - tilt, 0.0))
    chi = 1.0 / np.sqrt(1.0 + np.pi * tangent**2)
    # From above the effective cosines are χ: 1 where smooth.
    head_on = hapke_h(chi, gamma)[0]
    whole = 2.0 / ((1.0 + p[1]) * _lobes(p[3], p[4], 1.0) + head_on**2 - 1.0)
    return (
        whole, scattered, gamma, tangent, 2.0 / (np.pi * tangent), 1.0 / (np.pi * tangent**2),
        chi, cos_phase + zero,
    )  # fmt: skip


@compiled_inline
def shade_at(  # noqa: PLR0911  a choice
    code: int, terms: Terms, cos_incidence: float, cos_emission: float
) -> Shade:
    """Return the value Φ and its derivatives by both cosines, for the terms of a phase angle.

    Parameters
    ----------
    code : int
    terms : tuple of eight float
        From :func:`phase_terms`.
    cos_incidence, cos_emission : float
        All three results are 0 unless both are positive, NaN where one is unknown.
    """
    zero = 0.0 * terms[0]
    if cos_incidence <= 0.0 or cos_emission <= 0.0:
        return zero, zero, zero
    if not cos_incidence + cos_emission < np.inf:
        return zero + np.nan, zero + np.nan, zero + np.nan
    if code == _LAMBERT:
        return lambert(terms, cos_incidence, cos_emission)
    if code == _MINNAERT:
        return minnaert(terms, cos_incidence, cos_emission)
    if code == _AKIMOV:
        return akimov(terms, cos_incidence, cos_emission)
    if code == _HAPKE:
        return hapke(terms, cos_incidence, cos_emission)
    if code == _ROUGH:
        return rough_hapke(terms, cos_incidence, cos_emission)
    return lunar_lambert(terms, cos_incidence, cos_emission)


@compiled
def shade(
    code: int, parameters: AnyArray, cos_incidence: float, cos_emission: float, phase: float
) -> Shade:
    """Return the value Φ and its derivatives by the cosines of incidence and emission.

    Parameters
    ----------
    code : int
        :attr:`spcola.photometry.functions.PhotometricFunction.code`.
    parameters : (8,) ndarray
        Its :attr:`~spcola.photometry.functions.PhotometricFunction.packed`.
    cos_incidence, cos_emission : float
    phase : float
        Radians.
    """
    if not phase < np.inf and cos_incidence > 0.0 and cos_emission > 0.0:
        return np.nan, np.nan, np.nan
    return shade_at(code, phase_terms(code, parameters, phase), cos_incidence, cos_emission)


@compiled
def shade_points(
    code: int, parameters: FloatArray, cosines: FloatArray, phase: FloatArray, found: FloatArray
) -> None:
    """Fill `found` (3, N): value and both derivatives at `cosines` (2, N) and `phase` (N,)."""
    for k in range(phase.size):
        value, by_i, by_e = shade(code, parameters, cosines[0, k], cosines[1, k], phase[k])
        found[0, k], found[1, k], found[2, k] = value, by_i, by_e


@compiled
def shade_parameters(
    code: int,
    parameters: FloatArray,
    slots: IntArray,
    cosines: FloatArray,
    phase: FloatArray,
    found: FloatArray,
) -> None:
    """Fill `found` (P, N): derivatives by the parameters in `slots` (P,) (complex step)."""
    stepped = parameters.astype(np.complex128)
    for j in range(slots.size):
        slot = slots[j]
        stepped[slot] = complex(parameters[slot], _STEP)
        for k in range(phase.size):
            incidence, emission = cosines[0, k], cosines[1, k]
            if incidence <= 0.0 or emission <= 0.0:
                found[j, k] = 0.0
            elif phase[k] < np.inf:
                terms = phase_terms(code, stepped, phase[k])
                found[j, k] = shade_at(code, terms, incidence, emission)[0].imag / _STEP
            else:
                found[j, k] = np.nan
        stepped[slot] = parameters[slot]
