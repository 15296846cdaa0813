"""Numbers with their sigmas, as a caption has them."""

from __future__ import annotations

from fusion.report.layout import number_text


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
