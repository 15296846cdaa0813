"""Surfaces, options and results of a match."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.estimation.verdict import Cause
from spcola.arrays import FloatArray
from spcola.grids import MapletGrid

# Fewer independent differences than this (twice the parameters of a match) give no covariance.
_MIN_PATCHES = 10.0


@dataclass(frozen=True)
class MatchOptions:
    """Options of the matching of mapolas.

    Parameters
    ----------
    capture_m : float
        Largest horizontal displacement of the search, metres.
    min_coverage : float
        Smallest share of the grid on which both surfaces must have heights.
    min_correlation : float
        Smallest correlation of the two surfaces, planes removed, after the match.
    ambiguity : float
        The match is ambiguous if another displacement leaves less than this multiple of the
        smallest variance of the difference.
    max_iterations : int
        Largest number of Gauss–Newton steps.
    """

    capture_m: float = 2.0
    min_coverage: float = 0.3
    min_correlation: float = 0.5
    ambiguity: float = 1.2
    max_iterations: int = 50


@dataclass(frozen=True, eq=False)
class Surface:
    """Heights on a grid with their sigmas.

    Parameters
    ----------
    height : (N, N) ndarray
        Metres along the grid's Uz; NaN where unknown.
    sigma : (N, N) ndarray, optional
        One standard deviation, metres; NaN or 0 where it is not known. A match uses only their
        ratios: their absolute size is estimated from the residuals.
    of_slopes : bool
        True if the slopes were smoothed (maplets), False if the heights were (facets of a shape: a
        chord lies below a round body).
    """

    height: FloatArray
    sigma: FloatArray | None = None
    of_slopes: bool = True

    @property
    def variance(self) -> FloatArray:
        """Squared sigma (N, N), m²; the median sigma where it is not known; 0 if known nowhere."""
        if self.sigma is None:
            return np.zeros(self.height.shape)
        known = np.isfinite(self.height) & (self.sigma > 0)
        if known.all():
            return self.sigma**2
        usual = float(np.median(self.sigma[known])) if known.any() else 0.0
        variance: FloatArray = np.where(known, self.sigma, usual) ** 2
        return variance


@dataclass(frozen=True, eq=False)
class Match:
    """Displacement of the lidar surface onto the SPC surface.

    Attributes
    ----------
    name : str
    center : (3,) ndarray
        V of the mapola before the move, body-fixed, metres.
    displacement : (3,) ndarray
        d, body-fixed, metres: ``V + d`` is the centre in SPC coordinates. NaN if not matched.
    covariance : (3, 3) ndarray
        Of d, square metres, from the match itself: the curvature of the misfit, given the spatial
        correlation of the residuals.
    local : (3,) ndarray
        d along Ux, Uy, Uz.
    residual : (2q+1, 2q+1) ndarray
        SPC minus moved lidar height minus a plane, metres; NaN where not compared.
    correlation, coverage : float
        Of the surfaces (planes removed) after the match; share of the grid compared.
    iterations : int
    reason : str
        Empty if the match is good, else why it must not be used.
    cause : Cause or None
        The code of the reason.
    at_lidar : bool
        Whether the SPC surface was displaced (the lidar has many gaps), so that `residual` refers
        to the grid points of the lidar; otherwise it refers to those of the SPC surface.
    """

    name: str
    center: FloatArray
    displacement: FloatArray
    covariance: FloatArray
    local: FloatArray
    residual: FloatArray
    correlation: float
    coverage: float
    iterations: int
    reason: str
    cause: Cause | None = None
    at_lidar: bool = False

    @property
    def usable(self) -> bool:
        """Whether the match may enter a fit."""
        return not self.reason

    @classmethod
    def failed(
        cls, name: str, grid: MapletGrid, coverage: float, cause: Cause, reason: str
    ) -> Match:
        """Return the result `name` of a failed match on `grid`, NaN except for `coverage`.

        `cause` and `reason` are those of the failure.
        """
        unknown = np.full(3, np.nan)
        return cls(
            name=name,
            center=grid.center,
            displacement=unknown,
            covariance=np.full((3, 3), np.nan),
            local=unknown,
            residual=np.full(grid.shape, np.nan),
            correlation=float("nan"),
            coverage=coverage,
            iterations=0,
            reason=reason,
            cause=cause,
        )

    def refused(self, cause: Cause, reason: str) -> Match:
        """Return the match with the `cause` and the `reason` why it must not be used."""
        return replace(self, cause=cause, reason=reason)

    def judged(self, options: MatchOptions, *, converged: bool, patches: float) -> Match:
        """Return the match with the reason why it must not be used, if there is one.

        Parameters
        ----------
        options : MatchOptions
        converged : bool
            Whether the displacement converged.
        patches : float
            Number of independent residuals.
        """
        cause, reason = None, ""
        if self.coverage < options.min_coverage:
            cause = Cause.NOT_COVERED
            reason = f"only {self.coverage:.0%} of the grid could be compared"
        elif not converged:
            cause = Cause.NOT_CONVERGED
            reason = f"the displacement did not converge in {self.iterations} steps"
        elif patches < _MIN_PATCHES:
            cause = Cause.FEW_INDEPENDENT
            reason = f"the differences are so correlated that only {patches:.0f} are independent"
        elif self.correlation < options.min_correlation:
            cause = Cause.UNCORRELATED
            reason = f"the surfaces correlate by {self.correlation:.2f} only"
        elif np.hypot(self.local[0], self.local[1]) > options.capture_m:
            cause = Cause.CAPTURE_RANGE
            reason = f"the displacement left the capture range ({options.capture_m} m)"
        return replace(self, cause=cause, reason=reason)

    def on_one_grid(self, lidar: FloatArray, spc: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return heights (N, N) of lidar and SPC at the same ground, metres.

        `lidar` and `spc` are the surfaces that were matched. The one that was not displaced is
        returned unchanged; the other is NaN where nothing was compared.
        """
        return (lidar, lidar + self.residual) if self.at_lidar else (spc - self.residual, spc)
