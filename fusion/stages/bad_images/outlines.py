"""The body, coarsely: what images that no ground could use should show."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.camera import SpcImage, project_image
from spcola.grids import MapletGrid
from spcola.imagematching import ChoiceOptions
from spcola.imagematching.frames.mistakes import BodyOutline
from spcola.shape import RayCaster

__all__ = ["Outline", "pixels_at"]

# Points of maplets: at most so many, or one of each.
_POINTS = 20000
# Without a shape maplets may cover a part of the body: it may reach as much farther.
_BEYOND = 2.0
# Correlation of brightness with the light from the other side, how much higher it is than with the
# light as stated, fewest points, and least standard deviation of the cosines of their incidences:
# ground that faces one way may be brighter on one side for other reasons.
_CORRELATED, _HIGHER, _FEWEST, _SPREAD = 0.4, 0.3, 50, 0.15


@dataclass(frozen=True, eq=False)
class Outline:
    """Points on the shape and on all maplets, with their normals.

    Parameters
    ----------
    body : BodyOutline
        Of these points.
    normals : (N, 3) ndarray
        Of its points, unit.
    """

    body: BodyOutline
    normals: FloatArray

    @classmethod
    def of(cls, shape: RayCaster | None, grids: Iterable[MapletGrid]) -> Outline:
        """Return the outline of a body.

        A frame may be narrower than the distance of points on the shape: maplets fill it.

        Parameters
        ----------
        shape : RayCaster, optional
        grids : iterable of MapletGrid
            Of all maplets.
        """
        grids = list(grids)
        edges = np.array([-1.0, 0.0, 1.0] if 9 * len(grids) <= _POINTS else [0.0])
        points = np.concatenate([_lattice(grid, edges) for grid in grids])
        normals = np.repeat([grid.uz for grid in grids], edges.size**2, axis=0)
        if shape is None:
            center: FloatArray = np.zeros(3)
            radius = _BEYOND * float(np.linalg.norm(points, axis=1).max())
        else:
            body = BodyOutline.of_mesh(shape.mesh)
            center, radius = body.center, body.radius
            lengths = np.linalg.norm(body.normals, axis=1)
            # Facets without an area have no normal.
            some = lengths > 0.0
            points = np.concatenate([body.points[some], points])
            normals = np.concatenate([body.normals[some] / lengths[some, None], normals])
        return cls(BodyOutline(center, radius, points, normals), normals)

    def mostly_dark(self, image: SpcImage, choice: ChoiceOptions) -> bool:
        """Whether an image shows ground, but by its state most of it in no light to be used.

        Parameters
        ----------
        image : SpcImage
            Its state; pixels are not needed.
        choice : ChoiceOptions
        """
        incident = self.normals[self._seen(image, choice)] @ image.sun
        if not incident.size:
            return False
        return float(np.mean(incident < np.cos(choice.most_incidence))) > 0.5

    def lit_from_the_other_side(self, image: SpcImage, choice: ChoiceOptions) -> bool:
        """Whether brightness follows light from the other side, and not as stated.

        Undecided, and no, where all ground in the frame faces one way.

        Parameters
        ----------
        image : SpcImage
            With pixels.
        choice : ChoiceOptions
        """
        seen = self._seen(image, choice)
        inside, values = pixels_at(image, self.body.points[seen])
        incident = (self.normals[seen] @ image.sun)[inside]
        if incident.size < _FEWEST or float(np.std(incident)) < _SPREAD:
            return False
        stated, other = (_correlation(values, np.maximum(s * incident, 0.0)) for s in (1.0, -1.0))
        return other > max(_CORRELATED, stated + _HIGHER)

    def _seen(self, image: SpcImage, choice: ChoiceOptions) -> BoolArray:
        """Whether points (N,) are in the frame, and face the camera enough for a maplet."""
        away = image.position - self.body.points
        rising = np.einsum("ij,ij->i", self.normals, away)
        seen = rising > np.cos(choice.most_emission) * np.linalg.norm(away, axis=1)
        seen[seen] = _in_frame(image, self.body.points[seen])[0]
        return seen


def pixels_at(image: SpcImage, points: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Return which points (N, 3) are in the frame of an image, and the pixels there.

    Parameters
    ----------
    image : SpcImage
        With pixels.
    points : (N, 3) ndarray
        Body-fixed, metres.

    Returns
    -------
    inside : (N,) ndarray of bool
    values : (M,) ndarray
        Brightness of the pixels at those inside.
    """
    assert image.pixels is not None
    inside, pixel, line = _in_frame(image, points)
    column, row = (np.rint(place[inside]).astype(int) - 1 for place in (pixel, line))
    width, height = image.size
    rows, columns = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
    return inside, np.asarray(image.pixels[rows, columns], dtype=np.float64)


def _in_frame(image: SpcImage, points: FloatArray) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return which points (N, 3) are in the frame, and their pixels and lines (N,)."""
    pixel, line = project_image(image, points)
    width, height = image.size
    inside = (pixel >= 0.5) & (pixel < width + 0.5) & (line >= 0.5) & (line < height + 0.5)
    return inside, pixel, line


def _lattice(grid: MapletGrid, edges: FloatArray) -> FloatArray:
    """Return points (N, 3) of a grid at shares of half its side."""
    steps = edges * grid.half_size * grid.gsd
    across = steps[:, None, None] * grid.uy + steps[None, :, None] * grid.ux
    points: FloatArray = (grid.center + across).reshape(-1, 3)
    return points


def _correlation(one: FloatArray, other: FloatArray) -> float:
    """Return the correlation of values (N,); 0 where one is constant."""
    a, b = one - one.mean(), other - other.mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0.0 else 0.0
