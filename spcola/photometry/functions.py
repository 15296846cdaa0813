"""Photometric functions: brightness of ground by the directions of light and view [16, 17].

A function Φ takes the cosines of incidence and emission and the phase angle, arrays of one shape,
and returns brightness relative to that at normal incidence and emission and zero phase, where
each is 1. Ground that the light or the view does not reach (a cosine ≤ 0) has brightness 0. None of
them models the darkening of the disk with phase: in SPC the factor λ of each image absorbs it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError

__all__ = ["PhotometricFunction", "lunar_lambert", "photometric_function"]

PhotometricFunction = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]

# McEwen (1996, LPSC XXVII, 841) for the Moon: L = 1 + A α + B α² + C α³, α in degrees.
_MCEWEN_PER_DEG = (-0.019, 2.42e-4, -1.46e-6)


def lommel_seeliger(
    cos_incidence: FloatArray, cos_emission: FloatArray, phase: FloatArray
) -> FloatArray:
    """Return ``2 μ0 / (μ0 + μ)``: single scattering in a dark regolith (Seeliger 1884)."""
    return _reached(cos_incidence, cos_emission, _lunar(cos_incidence, cos_emission) + 0.0 * phase)


def lambert(cos_incidence: FloatArray, cos_emission: FloatArray, phase: FloatArray) -> FloatArray:
    """Return ``μ0``: equally bright from all directions (Lambert 1760)."""
    return _reached(cos_incidence, cos_emission, cos_incidence + 0.0 * phase)


def lunar_lambert(
    cos_incidence: FloatArray, cos_emission: FloatArray, phase: FloatArray
) -> FloatArray:
    """Return ``2 L μ0 / (μ0 + μ) + (1 − L) μ0`` (McEwen 1991), 1 at normal.

    The weight L depends on the phase angle: see :func:`lunar_weight`. The truth images of
    Weirich et al. (section 2.6) were made with this function.

    Parameters
    ----------
    cos_incidence, cos_emission : ndarrays
        μ0 and μ.
    phase : ndarray
        Phase angle, radians.
    """
    weight = lunar_weight(phase)
    value = weight * _lunar(cos_incidence, cos_emission) + (1.0 - weight) * cos_incidence
    return _reached(cos_incidence, cos_emission, value)


def lunar_weight(phase: FloatArray) -> FloatArray:
    """Return McEwen's L at phase angles (…), radians: 1 at 0, then his cubic down to 0.

    McEwen (1996): ``L = 1 − 0.019 α + 2.42e−4 α² − 1.46e−6 α³``, α in degrees.
    """
    degrees = np.degrees(phase)
    a, b, c = _MCEWEN_PER_DEG
    return np.clip(1.0 + degrees * (a + degrees * (b + degrees * c)), 0.0, 1.0)


PHOTOMETRIC_FUNCTIONS: dict[str, PhotometricFunction] = {
    "lunar-lambert": lunar_lambert,
    "lommel-seeliger": lommel_seeliger,
    "lambert": lambert,
}
"""Functions by their names in settings; add further ones here."""


def photometric_function(name: str) -> PhotometricFunction:
    """Return the function of that name.

    Raises
    ------
    SettingsError
        If there is none.
    """
    if name not in PHOTOMETRIC_FUNCTIONS:
        known = ", ".join(PHOTOMETRIC_FUNCTIONS)
        raise SettingsError(f"{name!r} is none of {known}", "photometric function")
    return PHOTOMETRIC_FUNCTIONS[name]


def _lunar(cos_incidence: FloatArray, cos_emission: FloatArray) -> FloatArray:
    """Return ``2 μ0 / (μ0 + μ)``, arbitrary where a cosine is not positive."""
    with np.errstate(divide="ignore", invalid="ignore"):
        value: FloatArray = 2.0 * cos_incidence / (cos_incidence + cos_emission)
    return value


def _reached(cos_incidence: FloatArray, cos_emission: FloatArray, value: FloatArray) -> FloatArray:
    """Return the brightness, 0 where light or view do not reach; NaN where it is NaN."""
    dark = (cos_incidence <= 0.0) | (cos_emission <= 0.0)
    return np.where(dark, 0.0, value)
