"""A transform fitted to surfaces themselves, without the displacements of mapolas between."""

from __future__ import annotations

from dataclasses import dataclass

from fusion.estimation.verdict import Verdict
from fusion.registration.fit.fit import Model
from spcola.arrays import FloatArray
from spcola.math import Affine, Similarity


@dataclass(frozen=True, eq=False)
class DirectRegistration:
    """The transform that takes a moving surface to a fixed one.

    Attributes
    ----------
    transform : Affine
        ``V_fixed = translation + matrix · V_moving``.
    model : str
    parameters : tuple of str
        Names and order of the covariance's rows.
    covariance : (P, P) ndarray
        Units by the names; infinite where the ground falls into too few parts to tell.
    center : (3,) ndarray
        Point of the moving frame about which rotation and scale were parametrised.
    blur_cells : float
        Blur of the fixed surface against the moving one, cells, that was applied.
    residual_std_m : float
        Of the differences left, robust, metres.
    points, cells, clusters : int
        Points of the moving cloud that entered, grid points compared, and the clusters of them
        within which errors were taken to hold together.
    iterations : int
    converged : bool
    verdict : Verdict or None
        Whether it may be used; None where whoever asked for it judges it.
    """

    transform: Affine
    model: Model
    parameters: tuple[str, ...]
    covariance: FloatArray
    center: FloatArray
    blur_cells: float
    residual_std_m: float
    points: int
    cells: int
    clusters: int
    iterations: int
    converged: bool
    verdict: Verdict | None = None

    @property
    def similarity(self) -> Similarity:
        """The transform as a similarity (nearest one, for an affine fit)."""
        return self.transform.nearest_similarity()
