"""The fit of a rigid, similarity or affine transform to the displacements of mapolas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from fusion.estimation import ErrorSizes, MixedFit, MixedOptions, Observations, fit_mixed
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError
from spcola.math import Affine, Similarity

Model = Literal["rigid", "similarity", "affine"]

PARAMETERS: dict[str, tuple[str, ...]] = {
    "rigid": ("tx_m", "ty_m", "tz_m", "rx_rad", "ry_rad", "rz_rad"),
    "similarity": ("tx_m", "ty_m", "tz_m", "rx_rad", "ry_rad", "rz_rad", "scale"),
    "affine": ("tx_m", "ty_m", "tz_m", *(f"a{i}{j}" for i in "xyz" for j in "xyz")),
}
"""Order of the parameters in the covariance of each model."""

STRAIN_ROWS = np.zeros((5, 9))
"""Rows that take a matrix to xx − mean, yy − mean, xy, xz, yz of its symmetric part."""
STRAIN_ROWS[0, [0, 4, 8]] = [2 / 3, -1 / 3, -1 / 3]
STRAIN_ROWS[1, [0, 4, 8]] = [-1 / 3, 2 / 3, -1 / 3]
STRAIN_ROWS[[2, 3, 4], [1, 2, 5]] = STRAIN_ROWS[[2, 3, 4], [3, 6, 7]] = 0.5

SPC_FRAME = "spc"
LIDAR_FRAME = "lidar"


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
class Registration:
    """The fitted transform from lidar to SPC coordinates.

    Attributes
    ----------
    transform : Affine
        ``V_spc = translation + matrix · V_lidar``.
    model : str
    parameters : tuple of str
        Names and order of the covariance's rows.
    covariance : (P, P) ndarray
        Units by the names: metres, radians, none.
    joint : (P + M, P + M) ndarray
        The same with the strengths of the patterns of scan errors.
    center : (3,) ndarray
        Point about which rotation and scale were parametrised (mean of the mapola centres).
    observations : Observations
        Observations of the last step, to which ``fit`` refers.
    fit : MixedFit
        Residuals, weights, error sizes.
    iterations : int
        Gauss–Newton steps of the transform.
    """

    transform: Affine
    model: Model
    parameters: tuple[str, ...]
    covariance: FloatArray
    joint: FloatArray
    center: FloatArray
    observations: Observations
    fit: MixedFit
    iterations: int

    @property
    def similarity(self) -> Similarity:
        """The transform as a similarity (nearest one, for an affine fit)."""
        return self.transform.nearest_similarity()

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

    Returns
    -------
    Registration

    Raises
    ------
    NotObservableError
        If there are too few mapolas, or their positions do not determine a parameter.
    """
    options = options or FitOptions()
    names = PARAMETERS[options.model]
    if 3 * len(centers) < len(names):
        raise NotObservableError(
            f"{len(centers)} mapola(s) give {3 * len(centers)} numbers for {len(names)} parameters",
            names,
            do="match more mapolas, or set model = rigid",
        )
    groups = (effects, *further)
    center = np.mean(centers, axis=0)
    reach = max(float(np.sqrt(np.mean(np.sum((centers - center) ** 2, axis=1)))), 1e-6)
    mixed = MixedOptions(
        prior=np.full(len(names), np.inf),
        sizes=ErrorSizes(options.fixed_sizes[0], options.fixed_sizes[1:], width=0.0)
        if options.fixed_sizes
        else ErrorSizes(options.center_sigma_m, (1.0,) * len(groups), fixed=options.fixed_groups),
        # Without extent (one point) rotation and scale are not determined in any unit.
        scale=natural_sizes(names, max(reach, 1.0)),
        names=names,
        reject=options.reject,
    )
    target = centers + displacements
    current = _start(options.model, centers, target, center)
    iterations = 0
    while iterations < 10:
        iterations += 1
        design = transform_partials(options.model, current.nearest_similarity(), centers, center)
        value = target - current.apply(centers)
        observed = Observations(value, design, covariances, groups)
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
        current, options.model, names, covariance, joint, center, observed, fit, iterations
    )


def _start(model: Model, centers: FloatArray, target: FloatArray, center: FloatArray) -> Affine:
    """Plain least squares: close enough for linearisation and robust weights."""
    current = Affine(np.eye(3), np.zeros(3), SPC_FRAME, LIDAR_FRAME)
    for _ in range(4):
        design = transform_partials(model, current.nearest_similarity(), centers, center)
        value = (target - current.apply(centers)).ravel()
        step = np.linalg.lstsq(design.reshape(len(value), -1), value, rcond=1e-10)[0]
        current = updated_transform(current, step, model, center)
    return current


def transform_partials(
    model: Model, transform: Similarity, points: FloatArray, center: FloatArray
) -> FloatArray:
    """Partials (N, 3, P) of the mapped positions of `points` (N, 3) with respect to the model.

    Rotations are small ones about the body-fixed axes, applied after the transform; rotation,
    scale and matrix act about the image of `center`.

    Parameters
    ----------
    model : {"rigid", "similarity", "affine"}
    transform : Similarity
        Lidar to SPC coordinates, at which the partials are evaluated.
    points : (N, 3) ndarray
        Lidar coordinates, metres.
    center : (3,) ndarray
        Lidar coordinates, metres; zeros for partials that match ``Registration.covariance``.

    Returns
    -------
    (N, 3, P) ndarray
        Order of :data:`PARAMETERS`; metres per metre, radian, or unit of scale or matrix.
    """
    arms = transform.scale * transform.turn(points - center)
    count = len(points)
    shift = np.broadcast_to(np.eye(3), (count, 3, 3))
    if model == "affine":
        linear = np.einsum("ik,nj->nikj", np.eye(3), points - center).reshape(count, 3, 9)
        return np.concatenate([shift, linear], axis=2)
    # ∂(δθ × a)/∂δθ_j = e_j × a
    turning = np.stack([np.cross(axis, arms) for axis in np.eye(3)], axis=2)
    if model == "rigid":
        return np.concatenate([shift, turning], axis=2)
    return np.concatenate([shift, turning, (arms / transform.scale)[:, :, None]], axis=2)


def natural_sizes(names: tuple[str, ...], reach: float) -> FloatArray:
    """Size (P,) of each parameter that moves ground `reach` metres from the centre by a metre.

    Parameters
    ----------
    names : tuple of str
        Parameters as in :data:`PARAMETERS`.
    reach : float
        Metres.
    """
    return np.where([name.endswith("_m") for name in names], 1.0, 1.0 / reach)


def updated_transform(
    current: Affine, step: FloatArray, model: Model, center: FloatArray
) -> Affine:
    """Return `current` after a step (P,) of the parameters, which act about the image of `center`.

    Metres, radians, and units of scale or matrix, in the order of :data:`PARAMETERS`.

    Parameters
    ----------
    current : Affine
    step : (P,) ndarray
    model : {"rigid", "similarity", "affine"}
    center : (3,) ndarray
        Metres.
    """
    image = current.apply(center) + step[:3]
    if model == "affine":
        matrix = current.matrix + step[3:].reshape(3, 3)
    else:
        before = current.nearest_similarity()
        turn = Similarity.from_rotation_vector(step[3:6])
        scale = before.scale + (step[6] if model == "similarity" else 0.0)
        matrix = scale * turn.rotation @ before.rotation
    return Affine(matrix, image - matrix @ center, current.target, current.source)


def about_origin(
    covariance: FloatArray, model: Model, transform: Affine, center: FloatArray
) -> FloatArray:
    """Covariance for the translation of the origin instead of that of `center`.

    The translation T in ``V_spc = T + s R V`` is the image of the body's origin: the image of
    `center` minus the rotated and scaled arm between the two. Further rows of `covariance` after
    the parameters of the model are kept.

    Parameters
    ----------
    covariance : (P, P) ndarray
        With the translation of `center`.
    model : {"rigid", "similarity", "affine"}
    transform : Affine
    center : (3,) ndarray
        Metres.
    """
    if not np.isfinite(covariance).all():
        return covariance
    origin = np.zeros((1, 3))
    row = transform_partials(model, transform.nearest_similarity(), origin, center)[0]
    jacobian = np.eye(len(covariance))
    jacobian[:3, : row.shape[1]] = row
    return jacobian @ covariance @ jacobian.T


class TransformWithCovariance(Protocol):
    """A transform with its covariance about the origin, fitted or given."""

    @property
    def model(self) -> Model:
        """Name of the set of parameters."""
        ...

    @property
    def transform(self) -> Affine:
        """The transform."""
        ...

    @property
    def similarity(self) -> Similarity:
        """The transform as a similarity (nearest one, for an affine map)."""
        ...

    @property
    def covariance(self) -> FloatArray:
        """Of the parameters (P, P) in the order of :data:`PARAMETERS`."""
        ...


def similarity_numbers(
    registration: TransformWithCovariance,
) -> tuple[float, float, FloatArray, FloatArray]:
    """Scale, its sigma, rotation vector (3,) and its sigma (3,), radians, of any model.

    For an affine fit they are those of the polar decomposition, to first order; a rigid fit has
    scale 1 with sigma 0.

    Parameters
    ----------
    registration : Registration or KnownTransform
    """
    similarity, covariance = registration.similarity, registration.covariance
    if registration.model != "affine":
        sigma = np.sqrt(np.diag(covariance))
        scale_sigma = float(sigma[6]) if registration.model == "similarity" else 0.0
        return similarity.scale, scale_sigma, similarity.rotation_vector, sigma[3:6]
    # A ≈ s R (1 + E): s' = tr E / 3, δθ = antisymmetric part of E (first order in small E).
    rows = np.zeros((4, 9))
    rows[0, [0, 4, 8]] = 1.0 / 3.0
    for axis, (i, j) in enumerate([(2, 1), (0, 2), (1, 0)]):
        rows[axis + 1, 3 * i + j], rows[axis + 1, 3 * j + i] = 0.5, -0.5
    spread = np.sqrt(np.diag(rows @ covariance[3:, 3:] @ rows.T))
    return similarity.scale, float(spread[0]), similarity.rotation_vector, spread[1:]
