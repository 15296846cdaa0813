"""A value that was planted in a synthetic mission, and its estimate."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Recovered:
    """One planted value and its estimate.

    Attributes
    ----------
    name : str
    planted, recovered, sigma : float
        In `unit`; NaN where it was not estimated.
    unit : str
        Empty if dimensionless.
    explanation : str
        Of a large pull: see :func:`fusion.truth.causes.explained`.
    """

    name: str
    planted: float
    recovered: float
    sigma: float
    unit: str
    explanation: str = ""

    @property
    def pull(self) -> float:
        """(recovered − planted) / sigma; NaN without a sigma."""
        if not self.sigma > 0:
            return float("nan")
        return (self.recovered - self.planted) / self.sigma


@dataclass(frozen=True)
class SurfaceErrors:
    """Errors of the heights of one surface.

    Attributes
    ----------
    name : str
        Of the surface.
    share : float
        Of all grid points, those of which it has a height, 0 … 1.
    within_68_m, within_95_m : float
        68 % and 95 % of its errors are smaller than this, metres; NaN without any height.
    rms_m : float
        Root mean square of its errors, metres.
    """

    name: str
    share: float
    within_68_m: float
    within_95_m: float
    rms_m: float
