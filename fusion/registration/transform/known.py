"""Transforms with their covariance: fitted, or read from a file; their inverse."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.registration.transform.parameters import PARAMETERS, Model, transform_partials
from spcola.arrays import FloatArray, check_finite, check_shape
from spcola.errors import InvalidValueError
from spcola.math import Affine, Similarity

# Share of the largest eigenvalue: rounding to twelve figures may make eigenvalues this negative.
_NEGATIVE = 1e-9


@dataclass(frozen=True, eq=False)
class TransformWithCovariance:
    """A transform between two frames, and its covariance.

    Attributes
    ----------
    model : {"rigid", "similarity", "affine"}
    transform : Affine
        ``V_target = translation + matrix · V_source``, metres.
    covariance : (P, P) ndarray
        Of `parameters`, whose names have the units: metres, radians, none.
    """

    model: Model
    transform: Affine
    covariance: FloatArray

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names and order of the covariance's rows: one of :data:`PARAMETERS`."""
        return PARAMETERS[self.model]

    @property
    def similarity(self) -> Similarity:
        """The transform as a similarity; for an affine map, the nearest one."""
        return self.transform.nearest_similarity()

    def similarity_numbers(self) -> tuple[float, float, FloatArray, FloatArray]:
        """Return scale, its sigma, rotation vector (3,) and its sigma (3,), radians.

        Of an affine map they are those of the polar decomposition, to first order; a rigid
        transform has scale 1 with sigma 0.
        """
        similarity, covariance = self.similarity, self.covariance
        if self.model != "affine":
            sigma = np.sqrt(np.diag(covariance))
            scale_sigma = float(sigma[6]) if self.model == "similarity" else 0.0
            return similarity.scale, scale_sigma, similarity.rotation_vector, sigma[3:6]
        # A ≈ s R (1 + E): s' = tr E / 3, δθ = antisymmetric part of E (first order in small E).
        rows = np.zeros((4, 9))
        rows[0, [0, 4, 8]] = 1.0 / 3.0
        for axis, (i, j) in enumerate([(2, 1), (0, 2), (1, 0)]):
            rows[axis + 1, 3 * i + j], rows[axis + 1, 3 * j + i] = 0.5, -0.5
        spread = np.sqrt(np.diag(rows @ covariance[3:, 3:] @ rows.T))
        return similarity.scale, float(spread[0]), similarity.rotation_vector, spread[1:]


@dataclass(frozen=True, eq=False)
class KnownTransform(TransformWithCovariance):
    """A transform whose covariance has been checked, as it is written and read.

    Raises
    ------
    InvalidValueError
        If the covariance has another shape, is not finite, or is not a covariance.
    """

    def __post_init__(self) -> None:
        count = len(PARAMETERS[self.model])
        check_shape(self.covariance, (count, count), "covariance")
        check_finite(self.covariance, "covariance")
        unit = np.sqrt(np.maximum(np.diag(self.covariance), np.finfo(float).tiny))
        scaled = self.covariance / np.outer(unit, unit)
        if not np.allclose(scaled, scaled.T, rtol=0, atol=1e-6):
            raise InvalidValueError("is not symmetric", "covariance")
        values = np.linalg.eigvalsh((scaled + scaled.T) / 2.0)
        if np.diag(self.covariance).min() < 0 or values[0] < -_NEGATIVE * max(values[-1], 1.0):
            raise InvalidValueError("has negative variances", "covariance")

    @property
    def is_exact(self) -> bool:
        """Whether its covariance is 0."""
        return not self.covariance.any()

    def inverse(self) -> KnownTransform:
        """Return the inverse transform, with its covariance to first order."""
        jacobian = inverse_jacobian(self.model, self.transform)
        covariance = jacobian @ self.covariance @ jacobian.T
        return KnownTransform(self.model, self.transform.inverse(), covariance)

    def position_covariance(self, points: FloatArray) -> FloatArray:
        """Covariance (N, 3, 3), m², of the images of `points` (N, 3), metres."""
        design = transform_partials(self.model, self.similarity, points, np.zeros(3))
        return np.einsum("nip,pq,njq->nij", design, self.covariance, design)

    def numbers(self) -> dict[str, Any]:
        """Return it as ``registration.json`` has it: units in the keys."""
        scale, scale_sigma, rotation, rotation_sigma = self.similarity_numbers()
        content: dict[str, Any] = {
            "model": self.model,
            "scale": scale,
            "scale_sigma": scale_sigma,
            "rotation_deg": np.degrees(rotation),
            "rotation_sigma_deg": np.degrees(rotation_sigma),
            "translation_m": self.transform.translation,
            "translation_sigma_m": np.sqrt(np.diag(self.covariance)[:3]),
            "parameters": list(self.parameters),
            "covariance": self.covariance,
        }
        if self.model == "affine":
            content["matrix"] = self.transform.matrix
        return content


def inverse_jacobian(model: Model, transform: Affine) -> FloatArray:
    """Partials (P, P) of the parameters of the inverse with respect to those of `transform`.

    With B the inverse matrix and t' = −B t: δB = −B δA B and δt' = −B (δt + δA t'). Rotations are
    small and about the axes of each map's target frame, so that δθ' = −Rᵀ δθ.
    """
    back = transform.inverse()
    count = len(PARAMETERS[model])
    jacobian = np.zeros((count, count))
    jacobian[:3, :3] = -back.matrix
    if model == "affine":
        jacobian[:3, 3:] = -np.kron(back.matrix, back.translation)
        jacobian[3:, 3:] = -np.kron(back.matrix, back.matrix.T)
        return jacobian
    similarity = transform.nearest_similarity()
    # A t' = −t, so that δA t' = −δθ × t + (δs/s) A t'.
    crossed = np.stack([np.cross(axis, transform.translation) for axis in np.eye(3)], axis=1)
    jacobian[:3, 3:6] = back.matrix @ crossed
    jacobian[3:6, 3:6] = -similarity.rotation.T
    if model == "similarity":
        jacobian[:3, 6] = -back.translation / similarity.scale
        jacobian[6, 6] = -1.0 / similarity.scale**2
    return jacobian


def known_transform(
    content: Mapping[str, Any], transform: Affine, where: str, *, do: str
) -> KnownTransform:
    """Read the model and covariance of `transform`.

    Without a covariance the transform counts as exact.

    Raises
    ------
    InvalidValueError
        If model or covariance are not valid; `where` and `do` are for its message.
    """
    model = content["model"]
    if model not in list(PARAMETERS):  # a list, so that unhashable values are refused too
        raise InvalidValueError(
            f"has the model {model!r}, and not one of {', '.join(PARAMETERS)}", where, do
        )
    names = PARAMETERS[model]
    if content.get("parameters", list(names)) != list(names):
        raise InvalidValueError(f"has parameters other than {', '.join(names)}", where, do)
    if model == "rigid" and abs(transform.nearest_similarity().scale - 1.0) > 1e-9:
        raise InvalidValueError("is rigid, but its scale is not 1", where, do)
    given = content.get("covariance")
    try:
        covariance = np.zeros((len(names), len(names))) if given is None else np.array(given, float)
        return KnownTransform(model, transform, covariance)
    except (TypeError, ValueError, OverflowError, InvalidValueError) as error:
        raise InvalidValueError(f"has no usable covariance ({error})", where, do) from error
