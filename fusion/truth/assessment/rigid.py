"""The translation and rotation that bring a model closest to the truth: an ICP without scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.linalg import eigh, norm
from scipy.spatial.transform import Rotation

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.math.robust import MAD_TO_SIGMA, huber_weight
from spcola.truth.body import SurfacePoints, TruthBody

# Directions in which the mean square of the residuals hardly changes (relative to the mean of
# all six) are not observable, such as the rotation of a sphere.
_FREE = 1e-7
# Errors of neighbouring vertices are correlated: the covariance takes each cell of a cube about
# the model, this many along a side, as one observation.
_CELLS = 6
GAIN = 1e-4
"""A pass ends when two successive steps have not reduced the rms by this share: on rough
surfaces the nearest points change with every step, and the rms has no smooth minimum."""
_IDLE_STEPS = 2


@dataclass(frozen=True)
class RigidOptions:
    """Options of the fit.

    Parameters
    ----------
    rotation : bool
        False: translation only.
    most_iterations : int
        Limit for each of the two passes.
    tolerance_m : float
        The fit has converged when a step moves no vertex by more than about this, metres, or
        the rms no longer decreases (see :data:`GAIN`).
    loss_scale : float
        Huber's limit of the first pass in robust standard deviations of the distances.
    """

    rotation: bool = True
    most_iterations: int = 30
    tolerance_m: float = 2e-5
    loss_scale: float = 2.5


@dataclass(frozen=True, eq=False)
class RigidFit:
    """A rigid motion of a model: ``p' = pivot + translation + R (p − pivot)``.

    Attributes
    ----------
    pivot : (3,) ndarray
        Mean of the vertices fitted, metres.
    translation : (3,) ndarray
        Metres.
    rotation : (3,) ndarray
        Rotation vector, radians; zero if only a translation was fitted.
    covariance : (6, 6) ndarray
        Covariance of translation and rotation (metres, radians), from the scatter of cells of the
        body, because errors of neighbouring vertices are correlated. NaN where a parameter is not
        observable or not fitted.
    rms : float
        Root mean square distance of the vertices fitted, metres.
    count, iterations : int
    converged : bool
    reason : str
        Why it did not converge, or what is not observable; else empty.
    """

    pivot: FloatArray
    translation: FloatArray
    rotation: FloatArray
    covariance: FloatArray
    rms: float
    count: int
    iterations: int
    converged: bool
    reason: str = ""

    def apply(self, points: FloatArray) -> FloatArray:
        """Move `points` (N, 3), metres."""
        turned = (points - self.pivot) @ Rotation.from_rotvec(self.rotation).as_matrix().T
        moved: FloatArray = self.pivot + self.translation + turned
        return moved


def fit_rigid(
    points: FloatArray, truth: TruthBody, *, options: RigidOptions | None = None
) -> RigidFit:
    """Return the motion of `points` (N, 3), metres, that minimises their 3D rms.

    Point-to-plane Gauss–Newton (Chen & Medioni 1992): the distance of a vertex changes with its
    motion along the truth's normal at the nearest point. A first pass with Huber's loss limits
    the effect of gross errors; the second weights all vertices equally, so that the result is the
    least root mean square of Weirich et al. (section 2.8). The scale is never fitted.

    Parameters
    ----------
    points : (N, 3) ndarray
        Vertices of the model, body-fixed, metres; all finite.
    truth : TruthBody
    options : RigidOptions, optional

    Returns
    -------
    RigidFit
        Not converged, with a reason, if there are fewer than 6 vertices.
    """
    options = options or RigidOptions()
    fit = _Fit(points, truth, options)
    if len(points) < 6:
        return fit.result(0, converged=False, reason="fewer than 6 vertices")
    done = 0
    converged = False
    for robust in (True, False):
        converged, best, idle = False, float("inf"), 0
        for _ in range(options.most_iterations):
            done += 1
            size, rms = fit.step(robust=robust)
            idle = 0 if rms < (1.0 - GAIN) * best else idle + 1
            best = min(rms, best)
            if size < options.tolerance_m or idle == _IDLE_STEPS:
                converged = True
                break
    reason = "" if converged else f"still moving after {options.most_iterations} iterations"
    return fit.result(done, converged=converged, reason=reason)


class _Fit:
    """The state of a fit: data, options and current pose."""

    def __init__(self, points: FloatArray, truth: TruthBody, options: RigidOptions) -> None:
        self.points, self.truth, self.options = points, truth, options
        self.pivot = points.mean(axis=0) if len(points) else np.zeros(3)
        arms = norm(points - self.pivot, axis=1)
        self.arm = max(float(np.sqrt(np.mean(arms**2))) if len(points) else 1.0, 1e-9)
        self.translation: FloatArray = np.zeros(3)
        self.turn = Rotation.identity()

    def moved(self) -> FloatArray:
        """Return the vertices (N, 3) at the current pose."""
        turned: FloatArray = (self.points - self.pivot) @ self.turn.as_matrix().T
        return self.pivot + self.translation + turned

    def step(self, *, robust: bool) -> tuple[float, float]:
        """Move by one Gauss–Newton step.

        Returns
        -------
        size, rms : float
            Motion of a typical vertex, and the weighted rms before it, metres.
        """
        here = self.moved()
        near = self.truth.nearest(here)
        weight: FloatArray = np.ones(len(here))
        if robust:
            # About zero, not about the median: a model with an offset everywhere is no outlier.
            spread = MAD_TO_SIGMA * max(float(np.median(np.abs(near.distance))), 1e-9)
            weight = huber_weight(near.distance / spread, self.options.loss_scale)
        design = self._design(here, near)
        normal = design.T @ (weight[:, None] * design)
        change = _pseudo_inverse(normal)[0] @ (design.T @ (weight * -near.distance))
        self.translation += change[:3]
        self.turn = Rotation.from_rotvec(change[3:] / self.arm) * self.turn
        rms = float(np.sqrt(np.mean(weight * near.distance**2)))
        return float(norm(change[:3]) + norm(change[3:])), rms

    def _design(self, here: FloatArray, near: SurfacePoints) -> FloatArray:
        """Return the partials (N, 6) of the distances by translation and rotation, in metres."""
        design = np.zeros((len(here), 6))
        design[:, :3] = near.normals
        if self.options.rotation:
            arms = here - self.pivot - self.translation
            design[:, 3:] = np.cross(arms, near.normals) / self.arm
        return design

    def result(self, iterations: int, *, converged: bool, reason: str) -> RigidFit:
        """Return the result at the current pose."""
        rms, covariance, free = float("nan"), np.full((6, 6), np.nan), ""
        if len(self.points):
            here = self.moved()
            near = self.truth.nearest(here)
            rms = float(np.sqrt(np.mean(near.distance**2)))
            covariance, free = self._covariance(here, near)
        why = "; ".join(part for part in (reason, free) if part)
        return RigidFit(
            self.pivot, self.translation, self.turn.as_rotvec(), covariance, rms,
            len(self.points), iterations, converged, why,
        )  # fmt: skip

    def _covariance(self, here: FloatArray, near: SurfacePoints) -> tuple[FloatArray, str]:
        """Return the covariance, by cells, and which parameters are not observable."""
        design = self._design(here, near)
        inverse, free = _pseudo_inverse(design.T @ design)
        label = _cells(here - self.pivot)
        scores = np.zeros((int(label.max()) + 1, 6))
        np.add.at(scores, label, design * near.distance[:, None])
        count = len(np.unique(label))
        fitted = 6 if self.options.rotation else 3
        factor = count / max(count - fitted, 1)
        scale = np.array([1.0, 1.0, 1.0, *[1.0 / self.arm] * 3])
        covariance = factor * inverse @ scores.T @ scores @ inverse * np.outer(scale, scale)
        unseen = free.copy()
        if not self.options.rotation:
            unseen[3:] = True
            free = np.append(free[:3], [False] * 3)
        covariance[unseen] = np.nan
        covariance[:, unseen] = np.nan
        names = np.array(["x", "y", "z", "rotation x", "rotation y", "rotation z"])
        left = ", ".join(names[free].tolist())
        return covariance, f"not observable, at least not separately: {left}" if left else ""


def _pseudo_inverse(normal: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the inverse (6, 6) over observable directions, and which parameters the rest has."""
    values, vectors = eigh(normal)
    seen = values > _FREE * max(float(np.trace(normal)) / 6.0, 1e-300)
    inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
    blind = vectors[:, np.logical_not(seen)]
    return inverse, np.sum(blind**2, axis=1) > 1e-3


def _cells(away: FloatArray) -> IntArray:
    """Return the cell (N,) of a cube about the origin to which each vector (N, 3) points."""
    face = np.argmax(np.abs(away), axis=1)
    row = np.arange(len(away))
    largest = away[row, face]
    others = np.stack([away[row, (face + k) % 3] for k in (1, 2)]) / np.where(
        largest == 0.0, 1.0, np.abs(largest)
    )
    across = np.clip(((others + 1.0) / 2.0 * _CELLS).astype(np.int64), 0, _CELLS - 1)
    side = 2 * face + (largest < 0)
    label: IntArray = (side * _CELLS + across[0]) * _CELLS + across[1]
    return label
