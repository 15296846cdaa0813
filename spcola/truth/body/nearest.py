"""The point of the synthetic body's surface that is nearest to a point in space."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.compilation import compiled
from spcola.truth.body.surface import Surface, block_radii

# Slopes are differences over this arc, metres, to both sides: on curves as sharp as the smallest
# boulder's, the truncation and rounding errors are both below 1e-7.
_ARC = 1e-5
_RINGS = 3
_PATTERN = 1 + 3 * _RINGS * (_RINGS + 1)
_MOST_PROJECTIONS = 40
# Accuracy of a place, metres: the distance is too large by its square over the distance, which is
# negligible.
_CLOSE = 1e-5
# Distance from the normal above which a place is on an edge.
_OFF_NORMAL = 1e-4


def search_pattern() -> FloatArray:
    """Return the points (37, 2) of a triangular lattice in the unit disc, the inner ones first."""
    steps = np.arange(-_RINGS, _RINGS + 1)
    a, b = np.meshgrid(steps, steps, indexing="ij")
    inside = np.abs(a + b) <= _RINGS
    a, b = a[inside], b[inside]
    points: FloatArray = np.column_stack([a + 0.5 * b, np.sqrt(0.75) * b]) / _RINGS
    return points[np.argsort(np.round(np.sum(points**2, axis=1), 9), kind="stable")]


@compiled
def _axes(d: FloatArray, e: FloatArray, f: FloatArray) -> None:
    """Fill `e` and `f` with unit vectors across the unit vector `d` and each other."""
    least = 0
    for axis in range(1, 3):
        if abs(d[axis]) < abs(d[least]):
            least = axis
    i, j = (least + 1) % 3, (least + 2) % 3
    size = np.sqrt(d[i] * d[i] + d[j] * d[j])
    e[least], e[i], e[j] = 0.0, -d[j] / size, d[i] / size
    f[0] = d[1] * e[2] - d[2] * e[1]
    f[1] = d[2] * e[0] - d[0] * e[2]
    f[2] = d[0] * e[1] - d[1] * e[0]


@compiled
def _scaled(vector: FloatArray) -> None:
    """Scale a vector (3,) to length 1."""
    size = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    vector[0], vector[1], vector[2] = vector[0] / size, vector[1] / size, vector[2] / size


@compiled
def normal_at(
    surface: Surface, d: FloatArray, normal: FloatArray, work: tuple[FloatArray, ...]
) -> float:
    """Fill `normal` (3,) with the outward unit normal in the unit direction `d` (3,).

    By central differences over 2e-5 m; returns the radius, metres. `work` is as in
    :func:`nearest_points`.
    """
    directions, radius, block, e, f = work
    _axes(d, e, f)
    arc = _ARC / surface.radius
    for k in range(4):
        side = arc if k % 2 == 0 else -arc
        for axis in range(3):
            directions[k, axis] = d[axis] + side * (e[axis] if k < 2 else f[axis])
        _scaled(directions[k])
    directions[4] = d
    block_radii(surface, directions[:5], radius[:5], block)
    along = (radius[0] - radius[1]) / (2.0 * arc) / radius[4]
    across = (radius[2] - radius[3]) / (2.0 * arc) / radius[4]
    for axis in range(3):
        normal[axis] = d[axis] - along * e[axis] - across * f[axis]
    _scaled(normal)
    return radius[4]


@compiled
def _away(d: FloatArray, radius: float, point: FloatArray) -> float:
    """Return the distance from `point` (3,) to the place at `radius` in the direction `d`."""
    x, y, z = radius * d[0] - point[0], radius * d[1] - point[1], radius * d[2] - point[2]
    return np.sqrt(x * x + y * y + z * z)


@compiled
def _project(
    surface: Surface,
    point: FloatArray,
    state: tuple[FloatArray, FloatArray],
    best: float,
    work: tuple[FloatArray, ...],
) -> float:
    """Bring a direction to where its point is nearest, by projection to tangent planes.

    `state` is the direction (3,) and the normal (3,) there, both changed in place; returns the
    distance. A step that does not bring it nearer is halved; it ends where no step does.
    """
    d, normal = state
    directions, radius, block = work[:3]
    for _ in range(_MOST_PROJECTIONS):
        size = normal_at(surface, d, normal, work)
        height = 0.0
        for axis in range(3):
            height += (point[axis] - size * d[axis]) * normal[axis]
        # Steps of 1, 1/2, 1/4, 1/8: all at once.
        for k in range(4):
            for axis in range(3):
                foot = point[axis] - height * normal[axis] - size * d[axis]
                directions[k, axis] = size * d[axis] + foot * 0.5**k
            _scaled(directions[k])
        block_radii(surface, directions[:4], radius[:4], block)
        nearest = 0
        for k in range(1, 4):
            one, other = directions[k], directions[nearest]
            if _away(one, radius[k], point) < _away(other, radius[nearest], point):
                nearest = k
        found = _away(directions[nearest], radius[nearest], point)
        gain = best - found
        if gain > 0.0:
            d[:] = directions[nearest]
            best = found
        if gain < _CLOSE * _CLOSE / max(best, _CLOSE):
            break
    return best


@compiled
def _search(
    surface: Surface,
    point: FloatArray,
    d: FloatArray,
    reach: tuple[float, float],
    pattern: FloatArray,
    work: tuple[FloatArray, ...],
) -> float:
    """Move `d` (3,) to the best of a `pattern` about `d`, if one is nearer.

    `reach` is the radius of the pattern, metres, and the distance so far; returns the new one.
    """
    directions, radius, block, e, f = work
    size, best = reach
    _axes(d, e, f)
    scale = size / np.sqrt(point[0] ** 2 + point[1] ** 2 + point[2] ** 2)
    count = len(pattern)
    for k in range(count):
        a, b = scale * pattern[k, 0], scale * pattern[k, 1]
        for axis in range(3):
            directions[k, axis] = d[axis] + a * e[axis] + b * f[axis]
        _scaled(directions[k])
    block_radii(surface, directions[:count], radius[:count], block)
    chosen = -1
    for k in range(count):
        found = _away(directions[k], radius[k], point)
        if found < best:
            best, chosen = found, k
    if chosen >= 0:
        d[:] = directions[chosen]
    return best


@compiled
def _sideways(point: FloatArray, d: FloatArray, radius: float, normal: FloatArray) -> float:
    """Return the distance of `point` from the normal of the place at `radius` in direction `d`."""
    height, square = 0.0, 0.0
    for axis in range(3):
        height += (point[axis] - radius * d[axis]) * normal[axis]
    for axis in range(3):
        square += (point[axis] - radius * d[axis] - height * normal[axis]) ** 2
    return np.sqrt(square)


@compiled
def _descend(
    surface: Surface,
    point: FloatArray,
    d: FloatArray,
    reach: tuple[float, float],
    pattern: FloatArray,
    work: tuple[FloatArray, ...],
) -> float:
    """Bring `d` (3,) nearer by hexagons that shrink where they do not help; return the distance.

    For edges, where projection does not converge.
    """
    step, best = reach
    while step > _CLOSE:
        found = _search(surface, point, d, (step, best), pattern[:7], work)
        if found >= best:
            step *= 0.4
        best = found
    return best


@compiled
def nearest_points(
    surface: Surface, pattern: FloatArray, points: FloatArray, out: FloatArray
) -> None:
    """Fill `out` (N, 7) with the surface point nearest to each of `points`, distance, normal.

    The search follows the surface by projection from the point in the same direction. Then the
    disc that alone can contain a nearer point is searched on a lattice, and followed again from
    the best place; on an edge, where projection fails, by ever smaller hexagons.
    """
    work = (
        np.empty((_PATTERN, 3)),
        np.empty(_PATTERN),
        np.empty((6, _PATTERN)),
        np.empty(3),
        np.empty(3),
    )
    d, tried, axis_of, normal = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(points)):
        point = points[i]
        axis_of[:] = point
        _scaled(axis_of)
        d[:] = axis_of
        size = normal_at(surface, d, normal, work)
        outside = point[0] * d[0] + point[1] * d[1] + point[2] * d[2] >= size
        best = _project(surface, point, (d, normal), _away(d, size, point), work)
        tried[:] = axis_of
        found = _search(surface, point, tried, (best, best), pattern, work)
        if found < best:
            best = _project(surface, point, (tried, normal), found, work)
            d[:] = tried
        size = normal_at(surface, d, normal, work)
        if _sideways(point, d, size, normal) > _OFF_NORMAL:
            best = _descend(surface, point, d, (best / _RINGS, best), pattern, work)
            size = normal_at(surface, d, normal, work)
        for axis in range(3):
            out[i, axis] = size * d[axis]
            out[i, 4 + axis] = normal[axis]
        out[i, 3] = best if outside else -best


@compiled
def normals(surface: Surface, directions: FloatArray, out: FloatArray) -> None:
    """Fill `out` (N, 3) with the outward unit normals in the unit `directions` (N, 3)."""
    work = (np.empty((5, 3)), np.empty(5), np.empty((6, 5)), np.empty(3), np.empty(3))
    for i in range(len(directions)):
        normal_at(surface, directions[i], out[i], work)
