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
    """

    name: str
    planted: float
    recovered: float
    sigma: float
    unit: str

    @property
    def pull(self) -> float:
        """(recovered − planted) / sigma; NaN without a sigma."""
        if not self.sigma > 0:
            return float("nan")
        return (self.recovered - self.planted) / self.sigma
