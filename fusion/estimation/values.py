"""Observations, error sizes (variance components), options and results of a mixed fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray, check_finite, check_shape


@dataclass(frozen=True, eq=False)
class Observations:
    """N observations of D components each, linear in P parameters and G groups of effects.

    Parameters
    ----------
    value : (N, D) ndarray
        Observed minus computed.
    design : (N, D, P) ndarray
        Partial derivatives with respect to the parameters.
    covariance : (N, D, D) ndarray
        Covariance of each observation's own error.
    effects : tuple of (N, D, R_g) ndarrays
        Design matrices of the random effects of each group (scans, images, days …); all effects of
        a group have one size.

    Raises
    ------
    InvalidValueError
        If shapes disagree or a number is not finite.
    """

    value: FloatArray
    design: FloatArray
    covariance: FloatArray
    effects: tuple[FloatArray, ...] = ()

    def __post_init__(self) -> None:
        count, size = self.value.shape
        check_shape(self.design, (count, size, None), "design")
        check_shape(self.covariance, (count, size, size), "covariance")
        for group in self.effects:
            check_shape(group, (count, size, None), "effects")
            check_finite(group, "effects")
        for name in ("value", "design", "covariance"):
            check_finite(getattr(self, name), name)

    def select(self, keep: BoolArray) -> Observations:
        """Return the observations chosen by the mask `keep` (N,)."""
        effects = tuple(group[keep] for group in self.effects)
        return Observations(self.value[keep], self.design[keep], self.covariance[keep], effects)


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


@dataclass(frozen=True, eq=False)
class MixedOptions:
    """Options of :func:`fusion.estimation.fit_mixed`.

    Parameters
    ----------
    prior : (P,) ndarray
        Standard deviation of the Gaussian prior (about 0) of each parameter; inf for none.
    sizes : ErrorSizes
        Prior of the error sizes.
    scale : (P,) ndarray
        Typical size of each parameter, which makes the normal matrix dimensionless before its rank
        is tested.
    names : tuple of str
        Names of the parameters, for messages.
    reject : float
        Observations with residuals of more than this many standard deviations are rejected.
    max_rounds : int
        Largest number of re-weightings before rejection begins, and again after.
    robust : bool
        False: plain weighted least squares, nothing rejected.
    """

    prior: FloatArray
    sizes: ErrorSizes
    scale: FloatArray
    names: tuple[str, ...]
    reject: float = 5.0
    max_rounds: int = 20
    robust: bool = True


@dataclass(frozen=True, eq=False)
class MixedFit:
    """Result of :func:`fusion.estimation.fit_mixed`.

    Attributes
    ----------
    estimate : (P,) ndarray
        In the units that the design matrix implies.
    covariance : (P, P) ndarray
        Covariance of the estimate, shared effects and priors included.
    joint : (P + R, P + R) ndarray
        Covariance of the estimate and of the effects of all groups of non-zero size, in order.
    residual : (N, D) ndarray
        Observed minus computed, shared effects **not** removed.
    conditional : (N, D) ndarray
        The same with the estimated shared effects removed.
    effects : tuple of (R_g,) ndarrays
        Estimated random effects of each group.
    weight : (N,) ndarray
        Final robust weights; 0 where rejected.
    sizes : ErrorSizes
        Estimated error sizes.
    iterations : int
    converged : bool
    reason : str
        Why the iteration stopped.
    moved : float
        Largest change of the estimate in the last round, in its sigmas.
    """

    estimate: FloatArray
    covariance: FloatArray
    joint: FloatArray
    residual: FloatArray
    conditional: FloatArray
    effects: tuple[FloatArray, ...]
    weight: FloatArray
    sizes: ErrorSizes
    iterations: int
    converged: bool
    reason: str
    moved: float = 0.0

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations (P,) of the estimate."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def used(self) -> BoolArray:
        """Mask (N,) of observations that were not rejected."""
        mask: BoolArray = self.weight > 0
        return mask
