"""An SPC solution of the synthetic body, degraded from the truth the way SPC does it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter

from spcola.arrays import FloatArray
from spcola.errors import SettingsError
from spcola.icq import IcqShape, icq_directions
from spcola.maplet import Maplet, MapletGrid
from spcola.similarity import Similarity
from spcola.truth.body import TruthBody

# Cells around a maplet that are evaluated too, so that smoothing has no edge.
_MARGIN = 7
# Slopes between which the surface passes from smooth to steep ground.
_STEEP = (0.5, 1.2)


@dataclass(frozen=True)
class SolutionSettings:
    """Error levels of the solution; the defaults are what is published for Bennu.

    Parameters
    ----------
    gsd : float
        Of the maplets, metres.
    half_size : int
        q of the maplets.
    maplets : int
        How many cover the body.
    noise : float
        Rms of the heights' error that is correlated over `correlation` cells, metres.
    correlation : float
        Distance, cells, at which its correlation has fallen to 1/e.
    center_sigma : float
        Of a maplet's centre, for each axis, metres.
    smoothing, steep_smoothing : float
        Gaussian (1 σ, cells) that even ground and steep edges are smoothed by.
    albedo_noise : float
        Rms of the error of the relative albedo.
    dark_latitude_deg : float
        The ground south of minus this latitude is never lit: no heights.
    twilight_latitude_deg : float
        Southward of minus this one the light is poor: the noise is `twilight` times stronger.
    twilight : float
    """

    gsd: float = 0.5
    half_size: int = 49
    maplets: int = 64
    noise: float = 0.10
    correlation: float = 5.0
    center_sigma: float = 0.06
    smoothing: float = 1.2
    steep_smoothing: float = 2.4
    albedo_noise: float = 0.01
    dark_latitude_deg: float = 77.0
    twilight_latitude_deg: float = 70.0
    twilight: float = 4.0

    def __post_init__(self) -> None:
        if self.gsd <= 0 or self.half_size < 4 or self.maplets < 4 or self.correlation <= 0:
            raise SettingsError("GSD, half-size, number or correlation too small", "maplets")
        if min(self.noise, self.center_sigma, self.smoothing, self.albedo_noise) < 0:
            raise SettingsError("must not be negative", "error levels of the solution")
        if not 0 < self.twilight_latitude_deg <= self.dark_latitude_deg <= 90:
            raise SettingsError("must be 0 < twilight ≤ dark ≤ 90", "latitudes of the dark pole")


def lattice(count: int) -> FloatArray:
    """Return `count` unit vectors (N, 3) spread evenly over the sphere (Fibonacci's spiral)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    longitude = np.pi * (1.0 + np.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - z**2)
    return np.stack([ring * np.cos(longitude), ring * np.sin(longitude), z], axis=1)


def latitudes_deg(points: FloatArray) -> FloatArray:
    """Return latitudes (…), degrees, of `points` (…, 3)."""
    ring = np.hypot(points[..., 0], points[..., 1])
    latitude: FloatArray = np.degrees(np.arctan2(points[..., 2], ring))
    return latitude


def heights_in_frame(body: TruthBody, grid: MapletGrid, to_frame: Similarity) -> FloatArray:
    """Return the truth's heights (2q+1, 2q+1), metres, on a grid of another frame.

    Parameters
    ----------
    body : TruthBody
    grid : MapletGrid
        In the frame that `to_frame` leads to from the body's own.
    to_frame : Similarity
        Planted similarity.
    """
    back = to_frame.inverse()
    true_grid = MapletGrid(
        back.apply(grid.center), back.turn(grid.axes), grid.gsd * back.scale, grid.half_size
    )
    return to_frame.scale * body.heights(true_grid)


def make_maplet(
    body: TruthBody,
    to_spc: Similarity,
    name: str,
    *,
    direction: FloatArray,
    settings: SolutionSettings,
    generator: np.random.Generator,
) -> Maplet:
    """Return one maplet in the frame of the solution.

    It faces the mean plane about `direction` (3,) and is wrong in the ways of `settings`; its
    sigma states how wrong: the noise, with the twilight, and what smoothing took away. Its
    centre lies on its own surface, except where that is dark.
    """
    width = 2.0 * settings.half_size * settings.gsd
    center, normal = body.mean_plane(direction, 0.6 * width)
    grid = MapletGrid.facing(
        to_spc.apply(center), to_spc.turn(normal), settings.gsd, settings.half_size
    )
    wide = MapletGrid(grid.center, grid.axes, grid.gsd, grid.half_size + _MARGIN)
    truth = heights_in_frame(body, wide, to_spc)
    places = to_spc.inverse().apply(wide.points(truth))
    south = -latitudes_deg(places)
    smooth, loss = smoothed(truth, settings)
    level = settings.noise * np.where(south > settings.twilight_latitude_deg, settings.twilight, 1)
    height = smooth + level * correlated_noise(truth.shape, settings.correlation, generator)
    height[south > settings.dark_latitude_deg] = np.nan
    albedo = body.albedo(places.reshape(-1, 3)).reshape(truth.shape)
    albedo = albedo + settings.albedo_noise * generator.normal(size=truth.shape)
    inner = (slice(_MARGIN, -_MARGIN),) * 2
    exact = Maplet(name, grid, height[inner], albedo[inner], np.hypot(level, loss)[inner])
    return _displaced(exact, settings, generator)


def _displaced(
    maplet: Maplet, settings: SolutionSettings, generator: np.random.Generator
) -> Maplet:
    """Put the centre on the surface and move the whole maplet by its centre's error."""
    grid, height = maplet.grid, maplet.height
    middle = height[grid.half_size, grid.half_size]
    rise = middle if np.isfinite(middle) else 0.0
    error = settings.center_sigma * generator.normal(size=3)
    moved = MapletGrid(grid.center + rise * grid.uz + error, grid.axes, grid.gsd, grid.half_size)
    return replace(
        maplet,
        grid=moved,
        height=height - rise,
        center_sigma=np.full(3, settings.center_sigma),
    )


def smoothed(height: FloatArray, settings: SolutionSettings) -> tuple[FloatArray, FloatArray]:
    """Smooth heights (R, C), metres: more where it is steep, so that boulders come out short.

    Returns
    -------
    height, loss : ndarrays (R, C)
        Smoothed heights; a local rms of what smoothing takes away, as the solution itself
        could tell it: from the difference of its two degrees of smoothing.
    """
    if settings.smoothing == 0.0:
        return height.copy(), np.zeros_like(height)
    even = gaussian_filter(height, settings.smoothing, mode="nearest")
    soft = gaussian_filter(height, settings.steep_smoothing, mode="nearest")
    detail = even - gaussian_filter(even, 4.0 * settings.steep_smoothing, mode="nearest")
    rows, columns = np.gradient(detail, settings.gsd)
    low, high = _STEEP
    share = np.clip((np.hypot(rows, columns) - low) / (high - low), 0.0, 1.0)
    mixed = even + share * (soft - even)
    loss = np.sqrt(gaussian_filter((even - soft) ** 2, 1.5, mode="nearest"))
    return mixed, loss


def correlated_noise(
    shape: tuple[int, ...], correlation: float, generator: np.random.Generator
) -> FloatArray:
    """Return noise of rms 1 whose correlation is 1/e at a distance of `correlation` cells.

    White noise under a Gaussian of σ = correlation / 2, divided by the rms that it leaves in the
    mean over all seeds: single samples are not scaled to their own.
    """
    width = correlation / 2.0
    margin = int(np.ceil(4.0 * width))
    white = generator.normal(size=(shape[0] + 2 * margin, shape[1] + 2 * margin))
    impulse = np.zeros(2 * margin + 1)
    impulse[margin] = 1.0
    gain = np.sum(gaussian_filter(impulse, width) ** 2)
    noise: FloatArray = gaussian_filter(white, width)[margin:-margin, margin:-margin] / gain
    return noise


def spc_shape(body: TruthBody, to_spc: Similarity, q: int) -> IcqShape:
    """Return the solution's shape model: the truth averaged over the facets' size.

    Each vertex takes the mean radius of nine directions over a quad's width about it.
    """
    directions = icq_directions(q).reshape(-1, 3)
    east = np.cross(
        directions, np.where(np.abs(directions[:, 2:]) < 0.9, [[0, 0, 1.0]], [[1, 0, 0]])
    )
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(directions, east)
    step = np.pi / 2.0 / q / 3.0
    mean = np.zeros(len(directions))
    for i in (-step, 0.0, step):
        for j in (-step, 0.0, step):
            mean += body.radius(directions + i * east + j * north) / 9.0
    vertices = to_spc.apply(mean[:, None] * directions).reshape(6, q + 1, q + 1, 3)
    return IcqShape(vertices, name="SHAPE")
