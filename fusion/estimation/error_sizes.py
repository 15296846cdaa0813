"""Sizes of errors that are estimated with the parameters (variance components)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray


@dataclass(frozen=True)
class ErrorSizes:
    """Standard deviations of errors beyond the observations' own covariance, in their unit.

    As a prior, each is the median of a log-normal distribution with standard deviation `width` of
    the natural logarithm. A size of 0 is fixed at 0, and a width of 0 fixes all.

    Parameters
    ----------
    independent : float
        Of the error of each observation.
    shared : tuple of float
        One size for each group of effects.
    width : float
        Standard deviation of the natural logarithm.
    fixed : tuple of int
        Indices of groups whose size is not estimated.
    """

    independent: float
    shared: tuple[float, ...] = ()
    width: float = 1.0
    fixed: tuple[int, ...] = ()

    @property
    def all(self) -> FloatArray:
        """All sizes (1 + G,): the independent one, then those of the groups."""
        return np.array([self.independent, *self.shared])
