"""ICQ shapes: the vertices of a body on the six faces of a cube ("implicitly connected")."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from spcola.arrays import BoolArray, FloatArray, IntArray, check_finite, frozen
from spcola.errors import InvalidValueError
from spcola.shape.mesh import Mesh

__all__ = [
    "IcqEdges",
    "IcqShape",
    "as_icq",
    "distinct_vertices",
    "first_open_edge",
    "icq_directions",
    "label_name",
]

# Pairs of labels that name one vertex (Gaskell's ICQ format): each word gives I, J and the face of
# one end, t running from 0 to Q and r from Q to 0.
_SHARED_EDGES = (
    ("tq6", "rq4"),
    ("t06", "tq2"),
    ("t05", "qr1"),
    ("t04", "r01"),
    ("t03", "0t1"),
    ("t02", "tq1"),
    ("qt6", "tq5"),
    ("qt5", "0t4"),
    ("qt4", "0t3"),
    ("qt3", "0t2"),
    ("0t6", "rq3"),
    ("0t5", "qt2"),
)

IcqEdges = Literal["mean", "first", "refuse"]
"""Place of a vertex whose labels differ by more than rounding."""

# Tolerance of labels of one vertex, over the largest radius: the rounding of the five decimals in
# ICQ files.
_EDGE_TOLERANCE = 1e-5
# Largest difference of labels of one vertex, over the largest radius: up to 3e-3 in published
# shapes whose faces were made one by one; much more if the order of labels or Q is another.
_LARGEST_GAP = 1e-2


@dataclass(frozen=True)
class EdgeGaps:
    """Differences between labels of one vertex.

    Attributes
    ----------
    shared : int
        Pairs of labels that name one vertex, 12 (Q + 1) of them.
    differing : int
        Pairs that differ by more than rounding, 1e-5 of the largest radius.
    max_m, rms_m : float
        Largest distance, and root mean square over those that differ, metres; 0 if none does.
    """

    shared: int
    differing: int
    max_m: float
    rms_m: float

    def __str__(self) -> str:
        return (
            f"{self.differing} of {self.shared} pairs of labels that name one vertex differ, by up "
            f"to {self.max_m:.3g} m (rms {self.rms_m:.3g} m)"
        )


@dataclass(frozen=True, eq=False)
class IcqShape:
    """A shape whose vertices are labelled (I, J, F), 0 ≤ I, J ≤ Q, faces F = 1 … 6.

    The faces look to +Z, −Y, −X, +Y, +X, −Z. Vertices on edges and corners have two or three
    labels: 6 (Q + 1)² labels name 6 Q² + 2 vertices. Each label is kept as given: :attr:`gaps`
    gives the differences for one vertex, :meth:`mesh` merges them.

    Parameters
    ----------
    vertices : (6, Q+1, Q+1, 3) array_like
        Body-fixed, metres, indexed ``[F − 1, J, I]``.
    layer : (6, Q+1, Q+1) array_like, optional
        The fourth column of a file: relative albedo, or sigma in metres.
    name : str
        Name of the body or file.

    Raises
    ------
    InvalidValueError
        If the arrays have other shapes, a value is not finite, or two labels of one vertex lie
        apart by more than a hundredth of the largest radius.
    """

    vertices: FloatArray
    layer: FloatArray | None = None
    name: str = "shape"

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen(self.vertices, (6, None, None, 3), "vertices"))
        faces, rows, columns, _ = self.vertices.shape
        if rows != columns or rows < 2:
            raise InvalidValueError(f"faces of {rows} × {columns} vertices are no ICQ", self.name)
        check_finite(self.vertices, f"{self.name}: vertices")
        if self.layer is not None:
            layer = frozen(self.layer, (faces, rows, columns), f"{self.name}: layer")
            object.__setattr__(self, "layer", layer)
        apart = first_open_edge(self.vertices)
        if apart is not None:
            one, other = (label_name(label, self.q) for label in apart)
            raise InvalidValueError(
                f"labels {one} and {other} name one vertex but differ by more than "
                f"{_LARGEST_GAP:.0%} of the largest radius",
                self.name,
            )

    @property
    def q(self) -> int:
        """Q: facets (quads) along the side of a face."""
        return self.vertices.shape[1] - 1

    @property
    def gaps(self) -> EdgeGaps:
        """Differences between labels of one vertex."""
        one, other = shared_labels(self.q)
        points = self.vertices.reshape(-1, 3)
        apart = np.linalg.norm(points[one] - points[other], axis=1)
        apart = apart[_differing(self.vertices, _EDGE_TOLERANCE)]
        if not len(apart):
            return EdgeGaps(len(one), 0, 0.0, 0.0)
        rms = float(np.sqrt(np.mean(apart**2)))
        return EdgeGaps(len(one), len(apart), float(apart.max()), rms)

    def mesh(self, *, distinct: bool = True, edges: IcqEdges = "mean") -> Mesh:
        """Return the shape as triangles, counter-clockwise seen from outside.

        A quad is split along (i, j)–(i+1, j+1) if
        ``|v(i,j) × v(i+1,j+1)| ≤ |v(i+1,j) × v(i,j+1)|``,
        else along the other diagonal.

        Parameters
        ----------
        distinct : bool
            True: 6 Q² + 2 vertices in the order of their first label, a closed surface. False:
            all 6 (Q + 1)² labels in the order of the file, edges doubled (as some OBJ files of
            ICQ shapes have them).
        edges : {"mean", "first", "refuse"}
            Where labels of one distinct vertex differ by more than rounding it is put at their
            mean, or at the first; or the shape is refused. Labels that agree are put at the first.

        Raises
        ------
        InvalidValueError
            If labels differ and `edges` is "refuse".
        """
        gaps = self.gaps
        if gaps.differing and edges == "refuse":
            raise InvalidValueError(str(gaps), self.name)
        labels = np.arange(6 * (self.q + 1) ** 2).reshape(6, self.q + 1, self.q + 1)
        points = self.vertices.reshape(-1, 3)
        facets = self._facets(labels)
        if distinct:
            number, first = distinct_vertices(self.q)
            facets = number[facets]
            points = points[first] if edges == "first" else self._merged(number, first)
        remark = f"{gaps}; {_MERGED[edges]}" if gaps.differing and distinct else ""
        return Mesh(points, facets, self.name, remark)

    def _merged(self, number: IntArray, first: IntArray) -> FloatArray:
        """Places of the vertices: the mean of labels that differ, else the first label's."""
        points = self.vertices.reshape(-1, 3)
        one, other = shared_labels(self.q)
        differing = _differing(self.vertices, _EDGE_TOLERANCE)
        mean = np.zeros((len(first), 3))
        np.add.at(mean, number, points)
        mean /= np.bincount(number)[:, None]
        chosen = points[first]
        apart = np.unique(number[np.concatenate([one, other])[np.tile(differing, 2)]])
        chosen[apart] = mean[apart]
        return chosen

    def _facets(self, labels: IntArray) -> IntArray:
        """Return the triangles (12 Q², 3) as label numbers."""
        corners = [labels[:, :-1, :-1], labels[:, :-1, 1:], labels[:, 1:, :-1], labels[:, 1:, 1:]]
        a, b, c, d = (corner.ravel() for corner in corners)  # (i,j) (i+1,j) (i,j+1) (i+1,j+1)
        points = self.vertices.reshape(-1, 3)
        along = np.linalg.norm(np.cross(points[a], points[d]), axis=1)
        across = np.linalg.norm(np.cross(points[b], points[c]), axis=1)
        first = np.where(along <= across, [a, d, b], [a, c, b])
        second = np.where(along <= across, [a, c, d], [b, c, d])
        return np.stack([first, second], axis=2).transpose(1, 2, 0).reshape(-1, 3)


_MERGED: dict[IcqEdges, str] = {
    "mean": "each such vertex is put at their mean",
    "first": "each such vertex is put at its first label",
}


def first_open_edge(vertices: FloatArray) -> tuple[int, int] | None:
    """Return the first two label numbers that name one vertex but lie apart, or None.

    Apart means by more than a hundredth of the largest radius, which no shape has.

    Parameters
    ----------
    vertices : (6, Q+1, Q+1, 3) ndarray
        Indexed ``[F − 1, J, I]``, any unit.
    """
    one, other = shared_labels(vertices.shape[1] - 1)
    apart = np.flatnonzero(_differing(vertices, _LARGEST_GAP))
    if not len(apart):
        return None
    first, second = sorted((int(one[apart[0]]), int(other[apart[0]])))
    return first, second


def _differing(vertices: FloatArray, share: float) -> BoolArray:
    """Return which pairs of shared labels differ by more than a share of the largest radius."""
    one, other = shared_labels(vertices.shape[1] - 1)
    points = vertices.reshape(-1, 3)
    gaps = np.max(np.abs(points[one] - points[other]), axis=1)
    radius = float(np.sqrt(np.max(np.sum(points**2, axis=1))))
    return gaps > share * radius


def label_name(number: int, q: int) -> str:
    """Return the label `number` (from 0, in the order of a file with Q = `q`) as ``(I, J, F)``."""
    face, rest = divmod(number, (q + 1) ** 2)
    return f"({rest % (q + 1)}, {rest // (q + 1)}, {face + 1})"


def shared_labels(q: int) -> tuple[IntArray, IntArray]:
    """Return pairs of label numbers, 12 (Q + 1) of them, that name one vertex (file order)."""
    t = np.arange(q + 1)
    places = {"t": t, "r": q - t, "0": np.zeros_like(t), "q": np.full_like(t, q)}

    def numbers(word: str) -> IntArray:
        return ((int(word[2]) - 1) * (q + 1) + places[word[1]]) * (q + 1) + places[word[0]]

    one = np.concatenate([numbers(pair[0]) for pair in _SHARED_EDGES])
    other = np.concatenate([numbers(pair[1]) for pair in _SHARED_EDGES])
    return one, other


def distinct_vertices(q: int) -> tuple[IntArray, IntArray]:
    """Return the vertex of each label of an ICQ (Q is `q`), and the first label of each vertex.

    Returns
    -------
    number : (6 (Q+1)²,) ndarray of int
        Vertex of each label, vertices numbered in the order of their first label.
    first : (6 Q² + 2,) ndarray of int
        First label of each vertex.
    """
    one, other = shared_labels(q)
    count = 6 * (q + 1) ** 2
    links = coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    component = connected_components(links, directed=False)[1]
    _, first, inverse = np.unique(component, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank[inverse], first[order]


def icq_directions(q: int) -> FloatArray:
    """Return unit vectors (6, Q+1, Q+1, 3) of evenly spread ICQ labels (Q is `q`): a unit sphere.

    Equal angles (not equal steps on the cube) between neighbours in the middle of a face, so
    that facets differ less in size.
    """
    steps = np.tan(np.pi / 4.0 * np.linspace(-1.0, 1.0, q + 1))
    b, a = np.meshgrid(steps, steps, indexing="ij")
    one = np.ones_like(a)
    faces = [(a, -b, one), (a, -one, -b), (-one, -a, -b), (-a, one, -b), (one, a, -b), (a, b, -one)]
    cube = np.array(faces).transpose(0, 2, 3, 1)
    return cube / np.linalg.norm(cube, axis=-1, keepdims=True)


def icq_q(count: int) -> int | None:
    """Return Q of an ICQ with `count` labels, 6 (Q + 1)²; None if no Q has so many."""
    side = round((count / 6) ** 0.5)
    return side - 1 if side >= 2 and 6 * side * side == count else None


def as_icq(mesh: Mesh) -> IcqShape | None:
    """Return a mesh whose vertices are the labels of an ICQ, in its order; None if they are not.

    They are if their number fits some Q, and labels of one vertex agree.
    """
    q = icq_q(len(mesh.vertices))
    if q is None:
        return None
    vertices = mesh.vertices.reshape(6, q + 1, q + 1, 3)
    if first_open_edge(vertices) is not None:
        return None
    return IcqShape(vertices, name=mesh.name)
