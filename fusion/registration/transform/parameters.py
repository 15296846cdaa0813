"""Parameters of a rigid, similarity or affine transform: partial derivatives, steps, origin."""

from __future__ import annotations

from typing import Literal

import numpy as np

from spcola.arrays import FloatArray
from spcola.math import Affine, Similarity

Model = Literal["rigid", "similarity", "affine"]

PARAMETERS: dict[str, tuple[str, ...]] = {
    "rigid": ("tx_m", "ty_m", "tz_m", "rx_rad", "ry_rad", "rz_rad"),
    "similarity": ("tx_m", "ty_m", "tz_m", "rx_rad", "ry_rad", "rz_rad", "scale"),
    "affine": ("tx_m", "ty_m", "tz_m", *(f"a{i}{j}" for i in "xyz" for j in "xyz")),
}
"""Order of the parameters in the covariance of each model."""

SPC_FRAME = "spc"
LIDAR_FRAME = "lidar"


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
    jacobian = np.eye(len(covariance))
    count = len(PARAMETERS[model])
    jacobian[:count, :count] = origin_jacobian(model, transform.nearest_similarity(), center)
    return jacobian @ covariance @ jacobian.T


def origin_jacobian(model: Model, transform: Similarity, center: FloatArray) -> FloatArray:
    """Partials (P, P) of the parameters about the origin by those about `center` (3,), metres."""
    jacobian = np.eye(len(PARAMETERS[model]))
    jacobian[:3] = transform_partials(model, transform, np.zeros((1, 3)), center)[0]
    return jacobian
