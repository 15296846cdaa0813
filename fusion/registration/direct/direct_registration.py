"""A transform fitted directly to two surfaces, without the displacements of mapolas."""

from __future__ import annotations

from dataclasses import dataclass

from fusion.estimation.verdict import Verdict
from fusion.registration.transform import TransformWithCovariance
from spcola.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class DirectRegistration(TransformWithCovariance):
    """The transform that takes a moving surface to a fixed one.

    Attributes
    ----------
    covariance : (P, P) ndarray
        Infinite if the ground has too few clusters to determine it.
    center : (3,) ndarray
        Point of the moving frame about which rotation and scale were parametrised.
    blur_cells : float
        Applied blur of the fixed surface relative to the moving one, cells.
    residual_std_m : float
        Robust standard deviation of the remaining differences, metres.
    points, cells, clusters : int
        Points of the moving cloud used, grid points compared, and clusters of grid points within
        which errors may be correlated.
    iterations : int
    converged : bool
    verdict : Verdict or None
        Whether it may be used; None if it was not judged.
    """

    center: FloatArray
    blur_cells: float
    residual_std_m: float
    points: int
    cells: int
    clusters: int
    iterations: int
    converged: bool
    verdict: Verdict | None = None
