"""An SPC solution of the synthetic body, degraded from the truth like those of SPC."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError
from spcola.grids import Maplet, MapletGrid
from spcola.grids.gaps import carried_on
from spcola.math import Similarity, lattice
from spcola.shape.icq import IcqShape, distinct_vertices, icq_directions
from spcola.truth.body.body import TruthBody
from spcola.truth.body.streams import stream
from spcola.truth.sampled.light import LightMap
from spcola.truth.solution.degradation import (
    Darkness,
    Shade,
    Smoothing,
    quadratic,
    shaded,
    smoothed,
    unresolved,
)
from spcola.truth.solution.noise import correlated_noise, drift_noise

# Cells evaluated around a maplet, so that smoothing has no edge effects.
_MARGIN = 8


@dataclass(frozen=True)
class SolutionSettings:
    """Error levels of the solution; the defaults are those published for Bennu.

    Parameters
    ----------
    gsd : float
        GSD of the maplets, metres.
    half_size : int
        q of the maplets.
    maplets : int, optional
        Number of maplets over the body; by default given by `overlap`.
    overlap : float
        Share of a side that a maplet has in common with the next.
    noise : float
        Rms of the heights' error that is correlated over `correlation` cells, metres.
    correlation : float
        Distance, cells, at which its correlation has fallen to 1/e.
    center_sigma : float
        Sigma of a maplet's centre, for each axis, metres.
    albedo_noise : float
        Rms of the error of the relative albedo.
    softness : Smoothing
        Smoothing of heights, and reduction of steep relief.
    darkness : Darkness
        Errors where light is poor.
    """

    gsd: float = 0.35
    half_size: int = 49
    maplets: int | None = None
    overlap: float = 0.37
    noise: float = 0.10
    correlation: float = 5.0
    center_sigma: float = 0.06
    albedo_noise: float = 0.01
    softness: Smoothing = field(default_factory=Smoothing)
    darkness: Darkness = field(default_factory=Darkness)

    def __post_init__(self) -> None:
        if self.gsd <= 0 or self.half_size < 4 or self.correlation <= 0:
            raise SettingsError("GSD, half-size or correlation too small", "maplets")
        if (self.maplets is not None and self.maplets < 4) or not 0 <= self.overlap <= 0.9:
            raise SettingsError("needs 4 at least, or an overlap of 0 … 0.9", "number of maplets")
        if min(self.noise, self.center_sigma, self.albedo_noise) < 0:
            raise SettingsError("must not be negative", "error levels of the solution")

    def count(self, radius: float) -> int:
        """Return the number of maplets over a body of mean `radius`, metres."""
        if self.maplets is not None:
            return self.maplets
        step = (1.0 - self.overlap) * 2.0 * self.half_size * self.gsd
        return max(4, int(np.ceil(4.0 * np.pi * (radius / step) ** 2)))


@dataclass(frozen=True, eq=False)
class SolvedMaplet:
    """A maplet of the solution, and the true place of its centre.

    Attributes
    ----------
    maplet : Maplet
        In the frame of the solution.
    true_center : (3,) ndarray
        The point of the true surface at the centre, body frame, metres.
    """

    maplet: Maplet
    true_center: FloatArray


def maplet_directions(body: TruthBody, settings: SolutionSettings) -> FloatArray:
    """Return the directions (N, 3) of maplets of these `settings` that cover the whole `body`."""
    return lattice(settings.count(body.settings.radius))


def heights_in_frame(body: TruthBody, grid: MapletGrid, to_frame: Similarity) -> FloatArray:
    """Return the heights (2q+1, 2q+1), metres, of a `body` on a `grid` of another frame.

    `to_frame` is the planted similarity from the body's frame.
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
    light: LightMap,
    settings: SolutionSettings,
    generator: np.random.Generator,
) -> SolvedMaplet:
    """Return one maplet in the frame of the solution.

    It faces the mean plane about `direction` (3,) and has the errors of `settings`: smoothed, with
    boulders too low, noisy where `light` is poor, with drift and without detail in the dark, and
    without heights deep in it. Its sigma states the errors that a solution could estimate: its
    noise, the expected loss by smoothing, and missing light. The centre has an error of its own
    sigma (and of the drift, in the dark), which moves all of it.

    Parameters
    ----------
    body : TruthBody
    to_spc : Similarity
        True → SPC coordinates.
    name : str
    direction : (3,) ndarray
        From the body's centre.
    light : LightMap
    settings : SolutionSettings
    generator : numpy Generator
    """
    grid = _facing(body, to_spc, direction, settings)
    wide = MapletGrid(grid.center, grid.axes, grid.gsd, grid.half_size + _MARGIN)
    truth = heights_in_frame(body, wide, to_spc)
    whole = carried_on(truth)
    back = to_spc.inverse()
    places = back.apply(wide.points(whole))
    shade = _shade(wide, whole, back, light, settings.darkness)
    drift = _drift(body, places, shade.depth, settings)
    height, sigma = _degraded(whole, shade, settings, generator)
    height, sigma = height + drift, np.hypot(sigma, settings.darkness.drift * shade.depth)
    height[shade.lost | np.isnan(truth)] = np.nan
    middle = (wide.half_size, wide.half_size)
    risen = grid.center + whole[middle] * grid.uz
    moved = drift[middle] * grid.uz + settings.center_sigma * generator.normal(size=3)
    inner = (slice(_MARGIN, -_MARGIN),) * 2
    maplet = Maplet(
        name,
        MapletGrid(risen + moved, grid.axes, grid.gsd, grid.half_size),
        (height - whole[middle] - drift[middle])[inner],
        _albedo(body, places[inner], shade.depth[inner], settings, generator),
        sigma[inner],
        np.hypot(settings.center_sigma, settings.darkness.drift * shade.depth[middle] * grid.uz),
    )
    return SolvedMaplet(maplet, back.apply(risen))


def _facing(
    body: TruthBody, to_spc: Similarity, direction: FloatArray, settings: SolutionSettings
) -> MapletGrid:
    """Return the grid on the mean plane about a direction, in the frame of the solution."""
    center, normal = body.mean_plane(direction, 1.2 * settings.half_size * settings.gsd)
    return MapletGrid.facing(
        to_spc.apply(center), to_spc.turn(normal), settings.gsd, settings.half_size
    )


def _shade(
    grid: MapletGrid, height: FloatArray, back: Similarity, light: LightMap, darkness: Darkness
) -> Shade:
    """Return the shade on a grid, including the effect of surroundings beyond its edge."""
    margin = darkness.margin
    around = MapletGrid(grid.center, grid.axes, grid.gsd, grid.half_size + margin)
    places = back.apply(around.points(np.pad(height, margin, mode="edge")))
    share = light.at(places.reshape(-1, 3)).reshape(around.shape)
    return shaded(share, darkness).cropped(margin)


def _degraded(
    truth: FloatArray, shade: Shade, settings: SolutionSettings, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return heights without their drift, and their sigma (R, C), metres."""
    trend = quadratic(truth)
    height = smoothed(truth - trend, settings.gsd, settings.softness)
    level = settings.noise * shade.noise
    loss = unresolved(height, settings.softness)
    noise = level * correlated_noise(truth.shape, settings.correlation, generator)
    return trend + shade.blurred(height) + noise, np.hypot(level, loss)


def _drift(
    body: TruthBody, places: FloatArray, depth: FloatArray, settings: SolutionSettings
) -> FloatArray:
    """Return the drift (...), metres, of heights at `places` (..., 3).

    The same in all maplets of a place, and in the shape; `depth` (...) is the depth of darkness.
    """
    if not depth.any():
        return np.zeros(depth.shape)
    seed = int(stream(body.settings.seed, "drift").integers(2**32))
    wavelength = settings.darkness.wavelength * settings.gsd
    return settings.darkness.drift * depth * drift_noise(places, wavelength, seed)


def _albedo(
    body: TruthBody,
    places: FloatArray,
    dark: FloatArray,
    settings: SolutionSettings,
    generator: np.random.Generator,
) -> FloatArray:
    """Return the relative albedo (R, C) of the solution: 1 where it cannot be determined."""
    truth = body.albedo(places.reshape(-1, 3)).reshape(dark.shape)
    noise = settings.albedo_noise * generator.normal(size=dark.shape)
    return 1.0 + (1.0 - dark) * (truth - 1.0) + noise


def spc_shape(
    body: TruthBody,
    to_spc: Similarity,
    q: int,
    *,
    light: LightMap | None = None,
    settings: SolutionSettings | None = None,
) -> IcqShape:
    """Return the solution's shape model: the truth averaged over facets, with drift in the dark.

    Each vertex is the mean radius of nine directions over a quad's width about it. Without `light`
    it drifts like the maplets of `settings`; the rest of their errors averages out over a facet.

    Parameters
    ----------
    body : TruthBody
    to_spc : Similarity
        True → SPC coordinates.
    q : int
        Facets along the side of a face.
    light : LightMap, optional
    settings : SolutionSettings, optional
    """
    # Labels of one vertex must be equal, whatever rounding does at the edge of a shadow.
    number, first = distinct_vertices(q)
    directions = icq_directions(q).reshape(-1, 3)[first]
    east = np.cross(
        directions, np.where(np.abs(directions[:, 2:]) < 0.9, [[0, 0, 1.0]], [[1, 0, 0]])
    )
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(directions, east)
    step = np.pi / 2.0 / q / 3.0
    settings = settings or SolutionSettings()
    mean, gone = np.zeros((2, len(directions)))
    for i in (-step, 0.0, step):
        for j in (-step, 0.0, step):
            about = directions + i * east + j * north
            radius = body.radius(about)
            mean += radius / 9.0
            if light is not None:
                share = light.at(radius[:, None] * about)
                gone += np.clip(1.0 - share / settings.darkness.dark, 0.0, 1.0) / 9.0
    mean += _drift(body, mean[:, None] * directions, gone, settings)
    vertices = to_spc.apply(mean[:, None] * directions)[number]
    return IcqShape(vertices.reshape(6, q + 1, q + 1, 3), name="SHAPE")
