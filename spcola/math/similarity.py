"""Similarity and affine maps between named frames."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import FloatArray, check_axes, check_finite, frozen
from spcola.errors import FrameMismatchError, InvalidValueError


@dataclass(frozen=True, eq=False)
class Affine:
    """An affine map ``x_target = translation + matrix · x_source``.

    Parameters
    ----------
    matrix : (3, 3) array_like
        Linear part, dimensionless.
    translation : (3,) array_like
        In metres, in the target frame.
    target, source : str
        Names of the frames; maps with different inner frames cannot be composed.

    Raises
    ------
    InvalidValueError
        If the arrays have other shapes, are not finite, or the matrix is singular.
    """

    matrix: FloatArray
    translation: FloatArray
    target: str = "target"
    source: str = "source"

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", frozen(self.matrix, (3, 3), "matrix"))
        object.__setattr__(self, "translation", frozen(self.translation, (3,), "translation"))
        check_finite(self.matrix, "matrix")
        check_finite(self.translation, "translation")
        if np.linalg.det(self.matrix) <= 0:
            raise InvalidValueError("must have a positive determinant", "matrix")

    def apply(self, points: ArrayLike) -> FloatArray:
        """Map points (…, 3), metres, from the source frame to the target frame."""
        return np.asarray(points, dtype=np.float64) @ self.matrix.T + self.translation

    def turn(self, vectors: ArrayLike) -> FloatArray:
        """Map difference vectors (…, 3): the linear part without the translation."""
        return np.asarray(vectors, dtype=np.float64) @ self.matrix.T

    def inverse(self) -> Affine:
        """Return the map from target to source."""
        inverse = np.linalg.inv(self.matrix)
        return Affine(inverse, -inverse @ self.translation, self.source, self.target)

    def __matmul__(self, first: Affine) -> Affine:
        """Return the map that applies `first` and then this one.

        Raises
        ------
        FrameMismatchError
            If `first` does not end in the frame in which this map begins.
        """
        check_frames_meet(self, first)
        return Affine(
            self.matrix @ first.matrix,
            self.apply(first.translation),
            self.target,
            first.source,
        )

    def nearest_similarity(self) -> Similarity:
        """Return the similarity whose rotation is the polar factor of the matrix.

        Its scale is the cube root of the determinant, so that volumes agree.
        """
        u, _, vt = np.linalg.svd(self.matrix)
        scale = float(np.cbrt(np.linalg.det(self.matrix)))
        return Similarity(u @ vt, self.translation, scale, self.target, self.source)


@dataclass(frozen=True, eq=False)
class Similarity:
    """A similarity ``x_target = translation + scale · rotation · x_source``.

    Parameters
    ----------
    rotation : (3, 3) array_like
        Right-handed rotation matrix.
    translation : (3,) array_like
        In metres, in the target frame.
    scale : float
        Positive, dimensionless.
    target, source : str
        Names of the frames.

    Raises
    ------
    InvalidValueError
        If `rotation` is not a rotation, or `scale` not positive.
    """

    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    translation: FloatArray = field(default_factory=lambda: np.zeros(3))
    scale: float = 1.0
    target: str = "target"
    source: str = "source"

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3), "rotation"))
        object.__setattr__(self, "translation", frozen(self.translation, (3,), "translation"))
        check_axes(self.rotation, "rotation", tolerance=1e-9)
        check_finite(self.translation, "translation")
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise InvalidValueError(f"must be positive, not {self.scale}", "scale")

    @classmethod
    def from_rotation_vector(
        cls,
        rotation_vector: ArrayLike,
        translation: ArrayLike = (0.0, 0.0, 0.0),
        scale: float = 1.0,
        target: str = "target",
        source: str = "source",
    ) -> Similarity:
        """Build from a rotation vector.

        Parameters
        ----------
        rotation_vector : (3,) array_like
            Axis times angle, radians.
        translation : (3,) array_like
            Metres.
        scale : float
        target, source : str
            Names of the frames.
        """
        from scipy.spatial.transform import Rotation  # noqa: PLC0415  # slow to import

        matrix = Rotation.from_rotvec(np.asarray(rotation_vector, dtype=np.float64)).as_matrix()
        return cls(matrix, np.asarray(translation, dtype=np.float64), scale, target, source)

    @property
    def rotation_vector(self) -> FloatArray:
        """The rotation as axis times angle (3,), radians."""
        from scipy.spatial.transform import Rotation  # noqa: PLC0415  # slow to import

        return Rotation.from_matrix(self.rotation).as_rotvec()

    def apply(self, points: ArrayLike) -> FloatArray:
        """Map points (…, 3), metres, from the source frame to the target frame."""
        turned: FloatArray = np.asarray(points, dtype=np.float64) @ self.rotation.T
        return self.translation + self.scale * turned

    def turn(self, directions: ArrayLike) -> FloatArray:
        """Rotate `directions` (…, 3): neither scaled nor translated."""
        return np.asarray(directions, dtype=np.float64) @ self.rotation.T

    def inverse(self) -> Similarity:
        """Return the map from target to source."""
        back = self.rotation.T
        return Similarity(
            back,
            -(back @ self.translation) / self.scale,
            1.0 / self.scale,
            self.source,
            self.target,
        )

    def __matmul__(self, first: Similarity) -> Similarity:
        """Return the map that applies `first` and then this one.

        Raises
        ------
        FrameMismatchError
            If `first` does not end in the frame in which this map begins.
        """
        check_frames_meet(self, first)
        return Similarity(
            self.rotation @ first.rotation,
            self.apply(first.translation),
            self.scale * first.scale,
            self.target,
            first.source,
        )

    def as_affine(self) -> Affine:
        """Return the same map as an :class:`Affine`."""
        return Affine(self.scale * self.rotation, self.translation, self.target, self.source)


def check_frames_meet(second: Affine | Similarity, first: Affine | Similarity) -> None:
    """Raise a FrameMismatchError unless `first` ends in the frame in which `second` begins."""
    if first.target != second.source:
        raise FrameMismatchError(
            f"{first.source} → {first.target} cannot be followed by "
            f"{second.source} → {second.target}"
        )


def similarity_between(points: ArrayLike, moved: ArrayLike) -> Similarity:
    """Return the similarity that takes points nearest to where they were moved.

    It minimises the sum of the squared distances (Umeyama 1991).

    Parameters
    ----------
    points, moved : (N, 3) array_like
        Metres, N ≥ 3, not on one line.

    Raises
    ------
    InvalidValueError
        If the points leave the rotation free.
    """
    source, target = np.asarray(points, dtype=np.float64), np.asarray(moved, dtype=np.float64)
    middle, aim = source.mean(axis=0), target.mean(axis=0)
    u, strength, vt = np.linalg.svd((target - aim).T @ (source - middle))
    if len(source) < 3 or strength[1] <= 1e-12 * strength[0]:
        raise InvalidValueError("lie on one line, or are fewer than three", "points")
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * sign) @ vt
    scale = float(strength @ sign / np.sum((source - middle) ** 2))
    return Similarity(rotation, aim - scale * rotation @ middle, scale)
