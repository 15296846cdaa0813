"""Numbers and places, as captions have them."""

from __future__ import annotations

from fusion.report.layout import number_text
from spcola.arrays import FloatArray
from spcola.math import lon_lat_deg


def measured(value: float | None, sigma: float | None) -> str:
    """Return a value to two digits of its sigma, and the sigma; without one the value.

    Parameters
    ----------
    value, sigma : float or None
        In one unit, which the caller writes behind.
    """
    if value is None:
        return "unknown"
    if not sigma:
        return number_text(value)
    return f"{number_text(value, sigma)} ± {number_text(sigma, sigma)}"


def millionths(value: float | None, sigma: float | None) -> str:
    """Return a ratio and its sigma in units of 10⁻⁶."""
    if value is None:
        return "unknown"
    return f"({measured(1e6 * value, None if sigma is None else 1e6 * sigma)}) · 10⁻⁶"


def place_text(point: FloatArray) -> str:
    """Return latitude and longitude of a body-fixed point (3,)."""
    longitude, latitude = lon_lat_deg(point)
    return f"{abs(latitude):.2f}° {'N' if latitude >= 0 else 'S'} {longitude:.2f}° E"
