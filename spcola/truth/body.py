"""The synthetic body: a seed, sizes, and questions that its surface answers exactly."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError
from spcola.maplet import MapletGrid
from spcola.truth.relief import (
    BURIED,
    CRATER_RIM,
    Features,
    PowerLaw,
    draw_boulders,
    draw_craters,
    index_features,
)
from spcola.truth.roughness import fractal_octaves, noise_field
from spcola.truth.streams import stream
from spcola.truth.surface import Surface, hits, radii

_CELLS = 48
_CHUNK = 16_384
# Gradient noise stays within ± 1.04 (Perlin's gradients of length √2, in three dimensions).
_NOISE_BOUND = 1.05


@dataclass(frozen=True)
class BodySettings:
    """What the body is like.

    Parameters
    ----------
    seed : int
        The same seed and settings give the same body on every machine.
    radius : float
        Of the smooth shape's mean, metres.
    shape : float
        1 for a spinning top, 0 for a sphere: factor of the low-degree coefficients.
    roughness : float
        Rms of the roughness at a wavelength of 4 m, metres; 0 for none.
    roughness_exponent : float
        The rms grows with this power of the wavelength.
    longest, shortest : float
        Wavelengths between which the body is rough, metres.
    roughness_contrast : float
        The amplitude goes as ``1 + contrast · (y² − x²)`` of the direction: greatest at 90° and
        270° of longitude (Weirich et al., section 2).
    craters, boulders : PowerLaw
        How many there are. Slopes are those of Weirich et al., who have 1e4 rocks on a
        square kilometre; a body so small would show hardly any.
    albedo : float
        Rms of the relative albedo about 1.
    """

    seed: int = 1
    radius: float = 75.0
    shape: float = 1.0
    roughness: float = 0.06
    roughness_exponent: float = 0.9
    longest: float = 38.4
    shortest: float = 1.2
    roughness_contrast: float = 0.3
    craters: PowerLaw = field(default_factory=lambda: PowerLaw(3.0e5, 2.9, 4.0, 25.0))
    boulders: PowerLaw = field(default_factory=lambda: PowerLaw(2.0e4, 2.7, 0.7, 8.0))
    albedo: float = 0.04

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise SettingsError(f"must be positive, not {self.radius} m", "radius")
        if self.roughness < 0 or not 0 < self.shortest <= self.longest:
            raise SettingsError("must be ≥ 0 over wavelengths 0 < shortest ≤ longest", "roughness")
        if not 0 <= self.albedo < 0.2:
            raise SettingsError(f"must lie in 0 … 0.2, not {self.albedo}", "albedo")

    @classmethod
    def sphere(cls, radius: float = 75.0) -> BodySettings:
        """Return settings of a smooth sphere of even albedo, for which formulas are known."""
        none = PowerLaw(0.0, 2.7, 1.0, 2.0)
        return cls(0, radius, shape=0.0, roughness=0.0, craters=none, boulders=none, albedo=0.0)


class TruthBody:
    """A body of known surface: ``r(direction)``, one radius in each direction.

    The surface is single-valued everywhere, boulders included: they are ellipsoids buried so far
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
        return draw_craters(self.settings.craters, self.settings.radius, self.settings.seed)

    @cached_property
    def boulders(self) -> Features:
        """Catalogue of the boulders, largest first."""
        return draw_boulders(self.settings.boulders, self.settings.radius, self.settings.seed)

    @cached_property
    def _surface(self) -> Surface:
        s = self.settings
        zonal, tesseral = _low_degree(s)
        octaves = fractal_octaves(s.roughness, 4.0, s.roughness_exponent, s.longest, s.shortest)
        low = s.radius * (np.abs(zonal).sum() + np.abs(tesseral).sum())
        rough = _NOISE_BOUND * octaves[:, 1].sum() * (1.0 + s.roughness_contrast)
        rims = 2.0 * CRATER_RIM * self.craters.diameter.max(initial=0.0)
        boulder = (1.0 - BURIED) * self.boulders.diameter.max(initial=0.0) / 2.0
        cover = float(rough + rims + boulder + 0.1)
        crater_lists = index_features(self.craters, s.radius, _CELLS)
        boulder_lists = index_features(self.boulders, s.radius, _CELLS)
        return Surface(
            s.radius, zonal, tesseral, octaves, s.roughness_contrast,
            _noise_seed(s.seed, "roughness"), _CELLS,
            self.craters.numbers, *crater_lists, self.boulders.numbers, *boulder_lists,
            s.radius + low + cover, cover,
        )  # fmt: skip

    def radius(self, directions: FloatArray) -> FloatArray:
        """Return the radius (N,), metres, in the `directions` (N, 3) of any length."""
        unit = _unit(directions)
        return _spread(radii, (self._surface,), (unit,))

    def cast(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Return the first hits (N, 3), metres, of rays on the surface; NaN where one misses.

        Parameters
        ----------
        origins : (N, 3) ndarray
            Metres; outside the body.
        directions : (N, 3) ndarray
            Of any length.
        """
        unit = _unit(directions)
        starts = np.ascontiguousarray(np.broadcast_to(origins, unit.shape), dtype=np.float64)
        distance = _spread(hits, (self._surface,), (starts, unit))
        points: FloatArray = starts + distance[:, None] * unit
        return points

    def heights(self, grid: MapletGrid) -> FloatArray:
        """Return the heights (2q+1, 2q+1) along Uz of the outermost surface, metres."""
        reach = 2.0 * self._surface.ceiling + grid.radius
        nodes = grid.points(np.full(grid.shape, reach)).reshape(-1, 3)
        found = self.cast(nodes, np.broadcast_to(-grid.uz, nodes.shape))
        height: FloatArray = ((found - grid.center) @ grid.uz).reshape(grid.shape)
        return height

    def albedo(self, directions: FloatArray) -> FloatArray:
        """Return the relative albedo (N,), about 1, in the `directions` (N, 3)."""
        octaves = fractal_octaves(self.settings.albedo, 4.0, 0.0, 32.0, 1.0)
        octaves[:, 1] /= np.sqrt(max(len(octaves), 1))
        points = self.settings.radius * _unit(directions)
        seed = _noise_seed(self.settings.seed, "albedo")
        return 1.0 + _spread(noise_field, (octaves, seed), (points,))

    def mean_plane(self, direction: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
        """Return centroid (3,), metres, and outward unit normal (3,) of the ground about.

        The plane is that of least squares through the surface over a square of `width`, metres,
        across `direction`.
        """
        middle = self.radius(direction[None])[0] * _unit(direction[None])[0]
        frame = MapletGrid.facing(middle, middle, width / 8.0, 4)
        nodes = _unit(frame.points(np.zeros(frame.shape)).reshape(-1, 3))
        points = self.radius(nodes)[:, None] * nodes
        centroid = points.mean(axis=0)
        normal = np.linalg.svd(points - centroid)[2][2]
        return centroid, normal if normal @ middle > 0 else -normal


def _low_degree(settings: BodySettings) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of a spinning top: flattened, ridged at the equator, a bit odd."""
    draw = stream(settings.seed, "low degree").uniform(-1.0, 1.0, size=10)
    zonal = np.array([-0.07, 0.012 * draw[0], 0.06])
    tesseral = draw[1:9].reshape(4, 2) * np.array([[0.010], [0.018], [0.010], [0.012]])
    return settings.shape * zonal, settings.shape * tesseral


def _noise_seed(seed: int, purpose: str) -> int:
    """Return a 32-bit seed of the lattice hash."""
    return int(stream(seed, purpose).integers(2**32))


def _unit(vectors: FloatArray) -> FloatArray:
    """Return `vectors` (N, 3) scaled to length 1, contiguous."""
    array = np.asarray(vectors, dtype=np.float64)
    lengths = np.sqrt(array[:, 0] ** 2 + array[:, 1] ** 2 + array[:, 2] ** 2)
    return np.ascontiguousarray(array / lengths[:, None])


def _spread(
    fill: Callable[..., None], fixed: tuple[Any, ...], rows: tuple[FloatArray, ...]
) -> FloatArray:
    """Call ``fill(*fixed, *rows, out)`` by chunks of the `rows` (N, 3), on all cores.

    Plain threads over kernels without the GIL rather than one parallel kernel: these may be
    called from worker threads, where parallel regions must not meet. Each result depends on its
    own row alone, so that chunks and threads leave no trace in it.
    """
    out = np.empty(len(rows[0]))
    cuts = [slice(i, i + _CHUNK) for i in range(0, len(out), _CHUNK)]

    def work(cut: slice) -> None:
        fill(*fixed, *(row[cut] for row in rows), out[cut])

    if len(cuts) <= 1:
        work(slice(None))
        return out
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(work, cuts))
    return out
