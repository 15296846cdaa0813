"""The synthetic body: a seed, sizes, and exact queries of its surface."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.grids import MapletGrid
from spcola.shape import Mesh
from spcola.shape.icq import IcqShape, icq_directions
from spcola.truth.body.albedo import AlbedoField, albedos
from spcola.truth.body.bounds import Bounds, make_bounds
from spcola.truth.body.cells import Indexed, cells_for, index_features
from spcola.truth.body.nearest import nearest_points, normals, search_pattern
from spcola.truth.body.relief import Features, draw_boulders, draw_craters, draw_spots
from spcola.truth.body.rocks import flag_rocks, make_rocks
from spcola.truth.body.roughness import fractal_octaves
from spcola.truth.body.settings import BodySettings
from spcola.truth.body.streams import stream
from spcola.truth.body.surface import Surface, radii
from spcola.truth.body.surface_points import SurfacePoints
from spcola.truth.body.terrain import BOULDER, flag
from spcola.truth.body.tracing import hits

_CHUNK = 16_384
# Q of the directions of the fingerprint.
_PROBES = 24
# Distance from the site's middle, in its radii, at which the ground is as rough as elsewhere.
_SITE_EDGE = 1.5
# A ray may leap this share of the smallest boulder: it cannot miss more of one than its thinnest
# edge.
_LEAP_SHARE = 0.3
# Craters larger than this, in the smallest flagged boulder, are flagged too.
_CRATER_FACTOR = 2.0


class TruthBody:
    """A body of known surface: ``r(direction)``, one radius in each direction.

    The surface is single-valued everywhere, boulders included: they are ellipsoids buried so deep
    that their sides end at a finite slope, and none overhangs. Lengths are metres in the
    body-fixed frame.

    Parameters
    ----------
    settings : BodySettings
    """

    def __init__(self, settings: BodySettings | None = None) -> None:
        self.settings = settings or BodySettings()

    @cached_property
    def craters(self) -> Features:
        """Catalogue of the craters, largest first."""
        s = self.settings
        return draw_craters(s.craters, s.radius, s.seed, s.site)

    @cached_property
    def boulders(self) -> Features:
        """Catalogue of the boulders, largest first."""
        s = self.settings
        return draw_boulders(s.boulders, s.radius, s.seed, s.site)

    @cached_property
    def spots(self) -> Features:
        """Catalogue of the bright and dark spots, largest first."""
        s = self.settings
        return draw_spots(s.spots, s.radius, s.seed, (s.bright, s.dark))

    @cached_property
    def _surface(self) -> Surface:
        s = self.settings
        octaves = fractal_octaves(
            s.roughness, 4.0, s.roughness_exponent, s.longest_used, s.shortest
        )
        site = _site_numbers(s)
        long = (2.0 / octaves[:, 0] > 2.0 * s.site.radius_on(s.radius)) if s.site else slice(0)
        swells = octaves[long]
        return Surface(
            s.radius, _low_degree(s), swells, octaves[len(swells) :], s.roughness_contrast,
            _noise_seed(s.seed, "roughness"), site,
            self._indexed(self.craters), self._indexed(self.boulders),
            make_rocks(s.boulders, s.smallest_rock, s.radius, _noise_seed(s.seed, "rocks"), s.site),
        )  # fmt: skip

    @cached_property
    def _bounds(self) -> Bounds:
        s = self.settings
        leap = _LEAP_SHARE * (s.smallest_rock or s.boulders.smallest)

        def radii_of(surface: Surface, unit: FloatArray) -> FloatArray:
            return _spread(radii, (surface,), (unit,))

        return make_bounds(self._surface, self.boulders, radii_of, leap)

    @cached_property
    def _albedo_field(self) -> AlbedoField:
        s = self.settings
        octaves = fractal_octaves(s.albedo, 4.0, 0.0, 64.0, min(1.0, s.shortest))
        octaves[:, 1] /= np.sqrt(max(len(octaves), 1))
        seed = _noise_seed(s.seed, "albedo")
        return AlbedoField(s.radius, octaves, seed, self._indexed(self.spots))

    def _indexed(self, features: Features) -> Indexed:
        chords = features.reach / self.settings.radius
        cells = cells_for(len(features))
        return index_features(features.numbers, features.direction, chords, cells)

    @cached_property
    def fingerprint(self) -> str:
        """Hexadecimal digest of radii and albedos over the body, to the last bit.

        Another version of this program that makes another body from the same settings gives another
        digest: measurements on the one are not valid for the other.
        """
        everywhere = icq_directions(_PROBES).reshape(-1, 3)
        values = np.stack([self.radius(everywhere), self.albedo(everywhere)])
        return hashlib.sha256(values.astype("<f8").tobytes()).hexdigest()

    def radius(self, directions: FloatArray) -> FloatArray:
        """Return the radius (N,), metres, in the `directions` (N, 3) of any length."""
        return _spread(radii, (self._surface,), (_unit(directions),))

    def outermost_radius(self, directions: FloatArray) -> FloatArray:
        """Return the greatest radius (N,), metres, in the `directions` (N, 3): the only one."""
        return self.radius(directions)

    def normals(self, directions: FloatArray) -> FloatArray:
        """Return the outward unit normals (N, 3) of the surface in the `directions` (N, 3)."""
        return _spread(normals, (self._surface,), (_unit(directions),), 3)

    def cast(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Return the first hits (N, 3), metres, of rays on the surface; NaN where one misses.

        Rays begin at `origins` (N, 3), metres, outside the body; `directions` may have any length.
        """
        return self._hits(origins, directions)[1]

    def first_hits(self, origins: FloatArray, directions: FloatArray) -> SurfacePoints:
        """Return distance, points and normals of the first hits of rays.

        `origins` and `directions` are as in :meth:`cast`.
        """
        distance, points = self._hits(origins, directions)
        across = np.full_like(points, np.nan)
        hit = np.isfinite(distance)
        across[hit] = self.normals(points[hit])
        return SurfacePoints(distance, points, across)

    def _hits(self, origins: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        unit = _unit(directions)
        starts = np.ascontiguousarray(np.broadcast_to(origins, unit.shape), dtype=np.float64)
        distance = _spread(hits, (self._surface, self._bounds), (starts, unit))
        return distance, starts + distance[:, None] * unit

    def nearest(self, points: FloatArray) -> SurfacePoints:
        """Return the points of the surface nearest to `points` (N, 3), metres.

        The result is a point of the surface to rounding, and the distance a local minimum within
        1e-8 m (for points further than 5 cm from it). It is the global minimum where the surface,
        within that distance of the point, has no detail narrower than a third of the distance:
        another bump may be nearer, by less than the height of that detail.
        """
        rows = np.ascontiguousarray(points, dtype=np.float64)
        found = _spread(nearest_points, (self._surface, search_pattern()), (rows,), 7)
        return SurfacePoints(found[:, 3], found[:, :3], found[:, 4:])

    def heights(self, grid: MapletGrid) -> FloatArray:
        """Return the heights (2q+1, 2q+1), metres, of the outermost surface over a `grid`."""
        reach = 2.0 * self._bounds.ceiling + grid.radius
        nodes = grid.points(np.full(grid.shape, reach)).reshape(-1, 3)
        found = self.cast(nodes, np.broadcast_to(-grid.uz, nodes.shape))
        return ((found - grid.center) @ grid.uz).reshape(grid.shape)

    def heights_near(self, grid: MapletGrid, model: FloatArray) -> FloatArray:  # noqa: ARG002
        """Return the heights (2q+1, 2q+1) on `grid`, whatever a `model`'s are."""
        return self.heights(grid)

    def icq(self, q: int) -> IcqShape:
        """Return the outermost surface as an ICQ shape of Q = `q`; its vertices lie on it."""
        directions = icq_directions(q)
        radius = self.outermost_radius(directions.reshape(-1, 3)).reshape(directions.shape[:-1])
        return IcqShape(radius[..., None] * directions, name="truth")

    def mesh(self, q: int) -> Mesh:
        """Return the surface as 12 q² triangles (q along the side of a cube's face)."""
        return self.icq(q).mesh()

    def albedo(self, directions: FloatArray) -> FloatArray:
        """Return the relative albedo (N,), about 1, in the `directions` (N, 3)."""
        return _spread(albedos, (self._albedo_field,), (_unit(directions),))

    def terrain(self, directions: FloatArray, *, smallest: float) -> AnyArray:
        """Return the terrain in the `directions` (N, 3): flags (N,) of uint8.

        The flags, of :mod:`spcola.truth.body.terrain`: BOULDER inside the outline of a boulder (or
        a rock) whose longest axis is at least `smallest`, metres; CRATER inside the rim of a crater
        at least twice as wide; SMOOTH on the smooth site.
        """
        unit = _unit(directions)
        counts = (
            int(np.count_nonzero(self.boulders.diameter >= smallest)),
            int(np.count_nonzero(self.craters.diameter >= _CRATER_FACTOR * smallest)),
        )
        flags = np.empty(len(unit), np.uint8)
        flag(self._surface, unit, *counts, flags)
        flag_rocks(self._surface.rocks, unit, smallest, BOULDER, flags)
        return flags

    def mean_plane(self, direction: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
        """Return centroid (3,), metres, and outward unit normal (3,) of the ground at a direction.

        The plane is the least-squares fit to the surface over a square of `width`, metres, across
        `direction`.
        """
        middle = self.outermost_radius(direction[None])[0] * _unit(direction[None])[0]
        frame = MapletGrid.facing(middle, middle, width / 8.0, 4)
        nodes = _unit(frame.points(np.zeros(frame.shape)).reshape(-1, 3))
        points = self.outermost_radius(nodes)[:, None] * nodes
        centroid = points.mean(axis=0)
        normal = np.linalg.svd(points - centroid)[2][2]
        return centroid, normal if normal @ middle > 0 else -normal


def _low_degree(settings: BodySettings) -> FloatArray:
    """Return the `shape` (11,) of a spinning top: flattened, with a ridge, irregular."""
    draw = stream(settings.seed, "low degree").uniform(-1.0, 1.0, size=10)
    zonal = np.array([-0.07, 0.012 * draw[0], 0.06])
    tesseral = draw[1:9] * np.repeat([0.010, 0.018, 0.010, 0.012], 2)
    return settings.shape * np.concatenate([zonal, tesseral])


def _site_numbers(settings: BodySettings) -> FloatArray:
    """Return the `site` (6,) of a :class:`Surface`; without extent if there is none."""
    if settings.site is None:
        return np.array([1.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    chord = settings.site.radius_on(settings.radius) / settings.radius
    ends = [chord, _SITE_EDGE * chord, settings.site.share]
    return np.concatenate([settings.site.direction, ends])


def _noise_seed(seed: int, purpose: str) -> int:
    """Return a 32-bit seed of the lattice hash."""
    return int(stream(seed, purpose).integers(2**32))


def _unit(vectors: FloatArray) -> FloatArray:
    """Return `vectors` (N, 3) scaled to length 1, contiguous."""
    array = np.asarray(vectors, dtype=np.float64)
    lengths = np.sqrt(array[:, 0] ** 2 + array[:, 1] ** 2 + array[:, 2] ** 2)
    return np.ascontiguousarray(array / lengths[:, None])


def _spread(
    fill: Callable[..., None],
    fixed: tuple[Any, ...],
    rows: tuple[FloatArray, ...],
    width: int | None = None,
) -> FloatArray:
    """Call ``fill(*fixed, *rows, out)`` by chunks of the `rows` (N, 3), on all cores.

    `out` is (N,), or (N, `width`). Plain threads over kernels without the GIL rather than one
    parallel kernel: these may be called from worker threads, where parallel regions are not
    allowed. Each result depends on its own row alone, whatever the chunks and threads.
    """
    out = np.empty(len(rows[0]) if width is None else (len(rows[0]), width))
    cuts = [slice(i, i + _CHUNK) for i in range(0, len(out), _CHUNK)]

    def work(cut: slice) -> None:
        fill(*fixed, *(row[cut] for row in rows), out[cut])

    if len(cuts) <= 1:
        work(slice(None))
        return out
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(work, cuts))
    return out
