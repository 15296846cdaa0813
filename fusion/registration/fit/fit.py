"""The fit of a rigid, similarity or affine transform to the displacements of mapolas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusion.estimation import ErrorSizes, MixedFit, MixedOptions, Observations, fit_mixed
from fusion.registration.transform import (
    PARAMETERS,
    Model,
    TransformWithCovariance,
    about_origin,
    natural_sizes,
    transform_partials,
    updated_transform,
)
from fusion.registration.transform.parameters import LIDAR_FRAME, SPC_FRAME
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError
from spcola.math import Affine

# Largest number of Gauss–Newton steps.
_MOST_STEPS = 10


@dataclass(frozen=True)
class FitOptions:
    """Options of the fit of the transform.

    Parameters
    ----------
    model : {"rigid", "similarity", "affine"}
    center_sigma_m : float
        Prior median of the error of a single maplet's centre, metres; its size is estimated.
    reject : float
        Mapolas whose residual exceeds this many standard deviations are rejected.
    fixed_sizes : tuple of float
        Fixed error sizes: of a centre, then the factors of the groups of effects. Empty: they are
        estimated.
    fixed_groups : tuple of int
        Groups of effects (scans are 0) with a factor fixed at 1.
    """

    model: Model = "similarity"
    center_sigma_m: float = 0.05
    reject: float = 5.0
    fixed_sizes: tuple[float, ...] = ()
    fixed_groups: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Registration(TransformWithCovariance):
    """The fitted transform from lidar to SPC coordinates.

    Attributes
    ----------
    joint : (P + M, P + M) ndarray
        The covariance with the strengths of the patterns of scan errors.
    centers : (N, 3) ndarray
        Mapola centres that it was fitted to, lidar coordinates, metres.
    center : (3,) ndarray
        Point about which rotation and scale were parametrised: their mean.
    observations : Observations
        Observations of the last step, to which ``fit`` refers.
    fit : MixedFit
        Residuals, weights, error sizes.
    iterations : int
        Gauss–Newton steps of the transform.
    """

    joint: FloatArray
    centers: FloatArray
    center: FloatArray
    observations: Observations
    fit: MixedFit
    iterations: int

    @property
    def residual_std(self) -> FloatArray:
        """Standard deviation (3,) of the residuals of the mapolas used, per axis, metres."""
        return np.std(self.fit.residual[self.fit.used], axis=0)

    @property
    def strengths(self) -> FloatArray:
        """Estimated strengths (M,) of the patterns of scan errors."""
        return self.fit.effects[0]

    def position_covariance(self, points: FloatArray, effects: FloatArray) -> FloatArray:
        """Covariance (N, 3, 3), m², of the registered positions of mapolas at `points` (N, 3).

        Of transform and scans jointly, as the transform compensates an error that all scans share.
        `effects` (N, 3, M) are the patterns of scan errors there.
        """
        partials = transform_partials(self.model, self.similarity, points, np.zeros(3))
        design = np.concatenate([partials, effects], axis=2)
        return np.einsum("nip,pq,njq->nij", design, self.joint, design)


def fit_transform(
    centers: FloatArray,
    displacements: FloatArray,
    covariances: FloatArray,
    effects: FloatArray,
    *,
    further: Sequence[FloatArray] = (),
    options: FitOptions | None = None,
) -> Registration:
    """Fit ``V_i + d_i = T + (1 + κ) R V_i`` robustly (Gaskell et al. §6.1).

    Parameters
    ----------
    centers : (N, 3) ndarray
        Mapola centres V_i in lidar coordinates, metres.
    displacements : (N, 3) ndarray
        d_i, metres.
    covariances : (N, 3, 3) ndarray
        Of each d_i from its match and the residual covariance of scans, square metres.
    effects : (N, 3, M) ndarray
        Displacement of each mapola, metres, by each pattern of scan errors, of standard deviation
        1. Mapolas of one scan share its error. A factor on all patterns is estimated; its prior
        median is 1.
    further : sequence of (N, 3, M_g) ndarrays
        The same for other shared errors, such as those of images, each group with its own factor.
        They are errors of the displacements and do not move a mapola.
    options : FitOptions, optional

    Raises
    ------
    NotObservableError
        If there are too few mapolas, or their positions do not determine a parameter.
    """
    options = options or FitOptions()
    names = _determined(options.model, len(centers))
    groups = (effects, *further)
    center = np.mean(centers, axis=0)
    reach = max(float(np.sqrt(np.mean(np.sum((centers - center) ** 2, axis=1)))), 1e-6)
    mixed = _mixed_options(options, reach, len(groups))
    target = centers + displacements
    current = _start(options.model, centers, target, center)
    iterations = 0
    while iterations < _MOST_STEPS:
        iterations += 1
        design = transform_partials(options.model, current.nearest_similarity(), centers, center)
        observed = Observations(target - current.apply(centers), design, covariances, groups)
        fit = fit_mixed(observed, mixed)
        current = updated_transform(current, fit.estimate, options.model, center)
        # The error sizes do not depend on where the transform is linearised.
        mixed = replace(mixed, sizes=replace(fit.sizes, width=0.0))
        if np.max(np.abs(fit.estimate) / mixed.scale) < 1e-7 * reach:
            break
    # Only the effects of scans move the mapolas.
    moving = len(names) + effects.shape[2]
    joint = about_origin(fit.joint[:moving, :moving], options.model, current, center)
    covariance = joint[: len(names), : len(names)]
    return Registration(
        options.model, current, covariance, joint, centers, center, observed, fit, iterations
    )


def _determined(model: Model, count: int) -> tuple[str, ...]:
    """Return the parameters of a model, if a number of mapolas may determine them."""
    names = PARAMETERS[model]
    if 3 * count < len(names):
        raise NotObservableError(
            f"{count} mapola(s) give {3 * count} numbers for {len(names)} parameters",
            names,
            do="match more mapolas, or set model = rigid",
        )
    return names


def _mixed_options(options: FitOptions, reach: float, groups: int) -> MixedOptions:
    """Options of the mixed model for mapolas that extend over `reach`, metres."""
    names = PARAMETERS[options.model]
    if options.fixed_sizes:
        sizes = ErrorSizes(options.fixed_sizes[0], options.fixed_sizes[1:], width=0.0)
    else:
        sizes = ErrorSizes(options.center_sigma_m, (1.0,) * groups, fixed=options.fixed_groups)
    return MixedOptions(
        prior=np.full(len(names), np.inf),
        sizes=sizes,
        # Without extent (one point) rotation and scale are not determined in any unit.
        scale=natural_sizes(names, max(reach, 1.0)),
        names=names,
        reject=options.reject,
    )


def _start(model: Model, centers: FloatArray, target: FloatArray, center: FloatArray) -> Affine:
    """Unweighted least squares: close enough for linearisation and robust weights."""
    current = Affine(np.eye(3), np.zeros(3), SPC_FRAME, LIDAR_FRAME)
    for _ in range(4):
        design = transform_partials(model, current.nearest_similarity(), centers, center)
        value = (target - current.apply(centers)).ravel()
        step = np.linalg.lstsq(design.reshape(len(value), -1), value, rcond=1e-10)[0]
        current = updated_transform(current, step, model, center)
    return current
