"""Triangle meshes: the shape of a body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spcola.arrays import FloatArray, IntArray, check_finite, frozen, read_only
from spcola.errors import InvalidValueError

# Relief that facets do not resolve, of their side.
_MISSED_RELIEF = 0.1


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in the body-fixed frame.

    Parameters
    ----------
    vertices : (V, 3) array_like
        Metres.
    facets : (F, 3) array_like of int
        Vertex indices (from 0), counter-clockwise seen from outside.
    name : str
        Name of the body, or of the file.
    remark : str
        Choices made in reading the file, in one line; empty if none.

    Raises
    ------
    InvalidValueError
        If a vertex is not finite or a facet names a vertex that does not exist.
    """

    vertices: FloatArray
    facets: IntArray
    name: str = "shape"
    remark: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen(self.vertices, (None, 3), "vertices"))
        check_finite(self.vertices, f"{self.name}: vertices")
        facets = np.array(self.facets, dtype=np.int64)
        if facets.ndim != 2 or facets.shape[1] != 3:
            raise InvalidValueError(
                f"facets have shape {facets.shape}, (F, 3) is needed", self.name
            )
        if facets.size and (facets.min() < 0 or facets.max() >= len(self.vertices)):
            raise InvalidValueError("a facet names a vertex that does not exist", self.name)
        object.__setattr__(self, "facets", read_only(facets))

    @cached_property
    def corners(self) -> FloatArray:
        """Vertex positions of each facet (F, 3, 3), metres: [facet, corner, component]."""
        return self.vertices[self.facets]

    @cached_property
    def area_vectors(self) -> FloatArray:
        """Outward normals of the facets times their areas (F, 3), square metres."""
        # Not from `corners`, which would stay in memory.
        a, b, c = (self.vertices[self.facets[:, corner]] for corner in range(3))
        return np.cross(b - a, c - a) / 2.0

    @cached_property
    def normals(self) -> FloatArray:
        """Outward unit normals of the facets (F, 3); NaN for a facet without area."""
        lengths = np.linalg.norm(self.area_vectors, axis=1, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            normals: FloatArray = self.area_vectors / lengths
        return normals

    @cached_property
    def volume(self) -> float:
        """Enclosed volume, cubic metres (positive if the facets face outward)."""
        a, b, c = self.corners.transpose(1, 0, 2)
        return float(np.sum(np.cross(a, b) * c) / 6.0)

    @property
    def mean_radius(self) -> float:
        """Radius of the sphere of equal volume, metres."""
        return float(np.cbrt(3.0 * abs(self.volume) / (4.0 * np.pi)))

    @cached_property
    def facet_side(self) -> float:
        """Side of the square that two facets of the median area make, metres."""
        areas = np.linalg.norm(self.area_vectors, axis=1)
        return float(np.sqrt(2.0 * np.median(areas)))

    @cached_property
    def sagitta(self) -> float:
        """Distance of the middle of an edge below the round body whose chord it is, metres.

        l²/(8 R), with the facets' typical edge l and the median distance R of the vertices from the
        body's centre, which parts of a body have, too.
        """
        radius = float(np.median(np.linalg.norm(self.vertices, axis=1)))
        return self.facet_side**2 / (8.0 * radius)

    @property
    def missed_relief(self) -> float:
        """Largest likely sigma of the relief that the facets do not resolve, metres.

        A tenth of their side: twice what shapes of synthetic bodies like Bennu miss.
        """
        return _MISSED_RELIEF * self.facet_side
