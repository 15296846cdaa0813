"""Frames of paired bigmaps: a square around the central pixel of each image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.estimation.verdict import Cause
from fusion.surfacematch import MatchOptions
from spcola.arrays import FloatArray
from spcola.camera import SpcImage, ray
from spcola.grids import MapletGrid
from spcola.navigation import et_from_utc
from spcola.shape import RayCaster

# At Bennu squares of 100 m with a GSD of 50 cm were taken on a body of 245 m (Gaskell et al. §6.2).
_OF_RADIUS = 100.0 / 245.0
_CELLS = 200.0
# Fewest cells on a side for relief that determines a match; largest side as a share of the radius:
# the corners of a larger square lie more than a seventh of the radius below its plane.
_FEWEST_CELLS = 90.0
_MOST_OF_RADIUS = 0.6
# Number of rays on a side of a square for its mean normal.
_RAYS = 7


@dataclass(frozen=True)
class PairOptions:
    """Options of the construction and selection of pairs.

    Parameters
    ----------
    size_m : float
        Side of the square, metres.
    gsd_m : float
        GSD of both bigmaps, metres.
    match : MatchOptions
        Options of their match. Its `min_coverage` applies to each bigmap alone, too.
    max_emission_deg, max_incidence_deg : float
        Largest angles from the mean normal of the square to the spacecraft and to the Sun.
    """

    size_m: float
    gsd_m: float
    match: MatchOptions
    max_emission_deg: float = 60.0
    max_incidence_deg: float = 85.0

    @property
    def half_size(self) -> int:
        """Half-size of the bigmaps."""
        return max(4, round(self.size_m / self.gsd_m / 2.0))


@dataclass(frozen=True, eq=False)
class PairFrame:
    """The grid at the ground that an image shows, and the geometry there.

    Attributes
    ----------
    image : str
    time : float
        Ephemeris time, s.
    grid : MapletGrid
        Centred where the ray of the central pixel hits the shape, Uz along the mean normal.
    beam : (3,) ndarray
        Unit vector from the spacecraft (of the image, later of the returns) to that point.
    range : float
        Distance to it, metres.
    normal : (3,) ndarray
        Outward unit mean normal there.
    local_time_h : float
        Local solar time, hours.
    emission_deg, incidence_deg : float
        Of the image, from the mean normal.
    """

    image: str
    time: float
    grid: MapletGrid
    beam: FloatArray
    range: float
    normal: FloatArray
    local_time_h: float
    emission_deg: float
    incidence_deg: float

    def with_station(self, station: FloatArray) -> PairFrame:
        """Return the frame with the line of sight of the returns, from `station` (3,), metres.

        During a scan the spacecraft moves by degrees over the body: the range error of a return
        lies along its own beam, not along the boresight of an image taken before or after.
        """
        away = self.grid.center - station
        distance = float(np.linalg.norm(away))
        return replace(self, beam=away / distance, range=distance)


@dataclass(frozen=True)
class UnpairedImage:
    """An `image` without a pair, and why: `cause` and `reason`.

    `unmatched` if it has two surfaces that do not match.
    """

    image: str
    cause: Cause
    reason: str
    unmatched: bool = False


def pair_size(mean_radius: float, maplet_gsd: float) -> tuple[float, float]:
    """Default side and GSD of paired bigmaps, metres: 100 m and 50 cm at Bennu.

    The side is proportional to the radius, at least 90 GSD of the maplets and at most 0.6 radii;
    the GSD is a two-hundredth of it, but at least the maplets'.

    Parameters
    ----------
    mean_radius : float
        Of the body, metres.
    maplet_gsd : float
        Median of the maplets, metres.
    """
    wanted = max(_OF_RADIUS * mean_radius, _FEWEST_CELLS * maplet_gsd)
    size = _rounded(min(wanted, _MOST_OF_RADIUS * mean_radius))
    return size, _rounded(max(size / _CELLS, maplet_gsd))


def _rounded(value: float) -> float:
    """Round to two significant figures."""
    return float(f"{value:.1e}")


def frame_of_image(
    image: SpcImage, caster: RayCaster, options: PairOptions
) -> PairFrame | UnpairedImage:
    """Return the grid where the central pixel of `image` hits the shape (Gaskell et al. §6.2).

    Parameters
    ----------
    image : SpcImage
    caster : RayCaster
        Of the SPC shape, body-fixed.
    options : PairOptions

    Returns
    -------
    PairFrame or UnpairedImage
        The latter if the pixel misses the body, or emission or incidence angle are too large.

    Raises
    ------
    FormatError
        If the image's UTC is not valid.
    """
    camera = image.camera
    beam = ray(image, (camera.width + 1) / 2.0, (camera.height + 1) / 2.0)
    hit = caster.cast(image.position[None], beam[None])
    if not np.isfinite(hit.distance[0]):
        return UnpairedImage(image.name, Cause.OFF_BODY, Cause.OFF_BODY.meaning)
    point = hit.points[0]
    normal = mean_normal(caster, image.position, point, options.size_m)
    emission, incidence = _angle(normal, -beam), _angle(normal, image.sun)
    if emission > options.max_emission_deg:
        return _oblique(image.name, "emission", emission, options.max_emission_deg)
    if incidence > options.max_incidence_deg:
        return _oblique(image.name, "incidence", incidence, options.max_incidence_deg)
    return PairFrame(
        image=image.name,
        time=et_from_utc(image.utc),
        grid=MapletGrid.facing(point, normal, options.gsd_m, options.half_size),
        beam=beam,
        range=float(hit.distance[0]),
        normal=normal,
        local_time_h=local_time(point, image.sun),
        emission_deg=emission,
        incidence_deg=incidence,
    )


def mean_normal(
    caster: RayCaster, station: FloatArray, point: FloatArray, size_m: float
) -> FloatArray:
    """Mean outward normal (3,) of the shape over a square of `size_m` around `point` (3,), metres.

    Over the ground visible from `station` (3,). A single facet may lie on the flank of a boulder.
    """
    around = MapletGrid.facing(point, station - point, size_m / (_RAYS - 1), _RAYS // 2)
    targets = around.points(np.zeros(around.shape)).reshape(-1, 3)
    hits = caster.cast(station, targets - station)
    near = hits.hit & (np.linalg.norm(hits.points - point, axis=1) < size_m)
    total = hits.normals[near].sum(axis=0)
    mean: FloatArray = total / np.linalg.norm(total)
    return mean


def _angle(normal: FloatArray, direction: FloatArray) -> float:
    """Angle between a unit vector and a direction, degrees."""
    cosine = float(normal @ direction) / float(np.linalg.norm(direction))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _oblique(image: str, what: str, angle_deg: float, most_deg: float) -> UnpairedImage:
    over = f"the {what} at the central pixel is {angle_deg:.0f} deg, more than {most_deg:g}"
    return UnpairedImage(image, Cause.OBLIQUE, over)


def local_time(point: FloatArray, sun: FloatArray) -> float:
    """Local solar time, hours in [0, 24), at a body-fixed point with the Sun toward `sun`.

    `point` and `sun` (3,) are body-fixed, of any length; 12 h is noon, later toward the east.
    """
    east = np.arctan2(point[1], point[0]) - np.arctan2(sun[1], sun[0])
    return float((12.0 + np.degrees(east) / 15.0) % 24.0)
