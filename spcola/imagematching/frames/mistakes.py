"""States that cannot be right: what contradicts the shape, and which mistake would explain it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.shape import Mesh

__all__ = ["BodyOutline", "Mistake", "ViewProblem"]

# So many facets stand for the body.
_FACETS = 4096
# Inside by this share of the radius in the spacecraft's direction: shapes err by less.
_INSIDE = 0.9
_BEYOND_THE_EDGE = 1.05


class ViewProblem(StrEnum):
    """What contradicts the shape at a state."""

    INSIDE = "inside-body"
    AWAY = "looks-away"
    TINY = "below-a-pixel"
    NIGHT = "no-sunlit-ground"

    @property
    def text(self) -> str:
        """The same in words."""
        return {
            ViewProblem.INSIDE: "the spacecraft is inside the body",
            ViewProblem.AWAY: "the body is not in the frame",
            ViewProblem.TINY: "the body is smaller than a pixel",
            ViewProblem.NIGHT: "the Sun does not reach the ground in the frame",
        }[self]


class Mistake(StrEnum):
    """A mistake in a table of states."""

    KM_AS_M = "km-as-m"
    M_AS_KM = "m-as-km"
    V0_REVERSED = "v0-reversed"
    SUN_REVERSED = "sun-reversed"
    AXES_TRANSPOSED = "axes-transposed"
    X_AND_Z_REVERSED = "cx-cz-reversed"
    Y_AND_Z_REVERSED = "cy-cz-reversed"

    @property
    def text(self) -> str:
        """The same in words."""
        return _WORDS[self]

    def mended(self, image: SpcImage) -> SpcImage:
        """Return an image with the state that it would have without this mistake.

        Parameters
        ----------
        image : SpcImage
        """
        factor = {Mistake.KM_AS_M: 1e3, Mistake.M_AS_KM: 1e-3, Mistake.V0_REVERSED: -1.0}.get(self)
        if factor is not None:
            return replace(image, scobj=factor * image.scobj)
        if self is Mistake.SUN_REVERSED:
            return replace(image, sun=-image.sun)
        if self is Mistake.AXES_TRANSPOSED:
            return replace(image, axes=image.axes.T)
        signs = [-1, 1, -1] if self is Mistake.X_AND_Z_REVERSED else [1, -1, -1]
        return replace(image, axes=np.array(signs)[:, None] * image.axes)


_WORDS = {
    Mistake.KM_AS_M: "V0 is 1000 times too short: kilometres read as metres",
    Mistake.M_AS_KM: "V0 is 1000 times too long: metres read as kilometres",
    Mistake.V0_REVERSED: "V0 has the wrong sign: it runs from the spacecraft to the body's centre",
    Mistake.SUN_REVERSED: "the vector to the Sun has the wrong sign",
    Mistake.AXES_TRANSPOSED: "the matrix of the axes is transposed: its rows are Cx, Cy, Cz",
    Mistake.X_AND_Z_REVERSED: "Cx and Cz have the wrong sign",
    Mistake.Y_AND_Z_REVERSED: "Cy and Cz have the wrong sign",
}


@dataclass(frozen=True, eq=False)
class BodyOutline:
    """A body, coarsely: what is quick to compare with a state.

    Parameters
    ----------
    center : (3,) ndarray
        Of the sphere around it, body-fixed, metres.
    radius : float
        Of that sphere, metres.
    points, normals : (N, 3) ndarray
        Some facets.
    """

    center: FloatArray
    radius: float
    points: FloatArray
    normals: FloatArray

    @classmethod
    def of_mesh(cls, mesh: Mesh) -> BodyOutline:
        """Return the outline of a shape.

        Parameters
        ----------
        mesh : Mesh
        """
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        center = (low + high) / 2.0
        radius = float(np.linalg.norm(mesh.vertices - center, axis=1).max())
        some = slice(None, None, max(1, len(mesh.facets) // _FACETS))
        corners = mesh.vertices[mesh.facets[some]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return cls(center, radius, corners.mean(axis=1), normals)

    def problem(self, image: SpcImage) -> ViewProblem | None:
        """Return what contradicts the body at the state of an image; None if nothing does.

        Parameters
        ----------
        image : SpcImage
        """
        place = image.position
        toward = self.points / np.linalg.norm(self.points, axis=1, keepdims=True)
        below = int(np.argmax(toward @ place))
        if np.linalg.norm(place) < _INSIDE * np.linalg.norm(self.points[below]):
            return ViewProblem.INSIDE
        away = float(np.linalg.norm(self.center - place))
        if 2.0 * self.radius < away * image.camera.pixel_angle:
            return ViewProblem.TINY
        wide = np.arcsin(min(self.radius / away, 1.0))
        if _angle(self.center - place, image.boresight) > wide + _half_field(image):
            return ViewProblem.AWAY
        beams = self.points - place
        seen = (np.einsum("ij,ij->i", self.normals, beams) < 0.0) & (
            beams @ image.boresight > np.cos(_half_field(image)) * np.linalg.norm(beams, axis=1)
        )
        lit = self.normals @ image.sun > 0.0
        return ViewProblem.NIGHT if seen.any() and not (seen & lit).any() else None

    def mistakes(self, image: SpcImage) -> tuple[Mistake, ...]:
        """Return the mistakes without which nothing would contradict the body.

        Parameters
        ----------
        image : SpcImage
        """
        return tuple(one for one in Mistake if self.problem(one.mended(image)) is None)


def _half_field(image: SpcImage) -> float:
    """Return the angle from the boresight to the corners of the frame, radians."""
    camera = image.camera
    corner = max(
        float(np.hypot(*(camera.center - [x, y]))) for x in (1, camera.width)
        for y in (1, camera.height)
    )  # fmt: skip
    return float(np.arctan(_BEYOND_THE_EDGE * corner * camera.pixel_angle))


def _angle(one: FloatArray, other: FloatArray) -> float:
    """Return the angle between vectors, radians."""
    cosine = one @ other / (np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))
