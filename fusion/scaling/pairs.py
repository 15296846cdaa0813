"""Paired bigmaps: for each image one of SPC maplets and one of lidar returns, compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fusion.registration.match import Match, MatchOptions, Surface, match_surfaces
from fusion.registration.resolution import estimate_blur
from fusion.scaling.observation import ScaleObservations, Trajectory
from fusion.scaling.shots import utc_date
from lidar.bigmap import LidarBigmapOptions, bigmap_from_returns
from lidar.returns import Returns
from spcola.arrays import FloatArray
from spcola.image import SpcImage
from spcola.maplet import Maplet, MapletGrid
from spcola.projection import ray
from spcola.rays import RayCaster
from spcola.time import et_from_utc


@dataclass(frozen=True)
class PairOptions:
    """How pairs are made and chosen.

    Parameters
    ----------
    size_m : float
        Side of the square, metres (100 at Bennu).
    gsd_m : float
        GSD of both bigmaps, metres (0.5 at Bennu).
    match : MatchOptions
        How the two are compared, and what is left out.
    """

    size_m: float
    gsd_m: float
    match: MatchOptions

    @property
    def half_size(self) -> int:
        """Half-size of the bigmaps."""
        return max(4, round(self.size_m / self.gsd_m / 2.0))


@dataclass(frozen=True, eq=False)
class PairFrame:
    """Where an image looks, and the grid that is laid there.

    Attributes
    ----------
    image : str
    time : float
        Ephemeris time, s.
    grid : MapletGrid
        Centred where the ray of the central pixel meets the shape, Uz along the mean normal.
    beam : (3,) ndarray
        Unit vector from the spacecraft to that point: of the image, then of the returns.
    range : float
        Distance to it, metres.
    normal : (3,) ndarray
        Outward unit normal there.
    local_time_h : float
        Local solar time, hours.
    """

    image: str
    time: float
    grid: MapletGrid
    beam: FloatArray
    range: float
    normal: FloatArray
    local_time_h: float


@dataclass(frozen=True, eq=False)
class Pair:
    """The two bigmaps of an image and how they lie to each other.

    Attributes
    ----------
    frame : PairFrame
    spc : Maplet
    lidar : Maplet
    match : Match
        Displacement that takes the lidar's surface to SPC's.
    shares : (S,) ndarray
        Share that each image's state (or each scan) has in where the returns lie.
    """

    frame: PairFrame
    spc: Maplet
    lidar: Maplet
    match: Match
    shares: FloatArray


@dataclass(frozen=True)
class LeftOut:
    """An image that gives no pair, and why."""

    image: str
    reason: str


def frame_of_image(image: SpcImage, caster: RayCaster, options: PairOptions) -> PairFrame | LeftOut:
    """Lay a grid where the central pixel of `image` meets the shape (Gaskell et al. §6.2).

    Parameters
    ----------
    image : SpcImage
    caster : RayCaster
        Of the SPC shape, body-fixed.
    options : PairOptions

    Returns
    -------
    PairFrame or LeftOut
        The latter where the pixel looks past the body or grazes it.

    Raises
    ------
    FormatError
        If the image's UTC is not a time.
    """
    camera = image.camera
    beam = ray(image, (camera.width + 1) / 2.0, (camera.height + 1) / 2.0)
    hit = caster.cast(image.position[None], beam[None])
    if not np.isfinite(hit.distance[0]):
        return LeftOut(image.name, "the central pixel looks past the body")
    point, normal = hit.points[0], hit.normals[0]
    if float(-normal @ beam) < _MIN_COSINE:
        return LeftOut(image.name, "the central pixel grazes the surface")
    return PairFrame(
        image=image.name,
        time=et_from_utc(image.utc),
        grid=MapletGrid.facing(point, normal, options.gsd_m, options.half_size),
        beam=beam,
        range=float(hit.distance[0]),
        normal=normal,
        local_time_h=local_time(point, image.sun),
    )


def seen_from(frame: PairFrame, station: FloatArray) -> PairFrame:
    """The frame with the line of sight of the returns, from `station` (3,), metres.

    A scan takes minutes, in which the spacecraft moves by degrees over the body: the range error
    of a return lies along its own beam, not along the boresight of an image taken before or after.
    """
    away = frame.grid.center - station
    distance = float(np.linalg.norm(away))
    return replace(frame, beam=away / distance, range=distance)


# A single scan leaves cells empty; gaps of two cells are bridged, as MATH §7 does it.
_BRIDGING = LidarBigmapOptions(max_gap=2)

# Seen more obliquely than this a height difference is no range difference any more.
_MIN_COSINE = 0.2


def local_time(point: FloatArray, sun: FloatArray) -> float:
    """Local solar time, hours in [0, 24), at a body-fixed point with the Sun toward `sun`.

    `point` and `sun` (3,) are body-fixed, of any length; 12 h is noon, later toward the east.
    """
    east = np.arctan2(point[1], point[0]) - np.arctan2(sun[1], sun[0])
    return float((12.0 + np.degrees(east) / 15.0) % 24.0)


def make_pair(
    frame: PairFrame, spc: Maplet, returns: Returns, shares: FloatArray, options: PairOptions
) -> Pair | LeftOut:
    """Grid the returns in the frame of the image and match them to the SPC bigmap.

    Parameters
    ----------
    frame : PairFrame
    spc : Maplet
        The SPC bigmap on ``frame.grid``.
    returns : Returns
        Body-fixed, metres, located by the trajectory that is to be judged.
    shares : (S,) ndarray
        See :class:`Pair`.
    options : PairOptions

    Returns
    -------
    Pair or LeftOut
        The latter with the reason where there is nothing to match, or no match.
    """
    if not spc.valid.any():
        return LeftOut(frame.image, "no maplet lies there")
    lidar = bigmap_from_returns(frame.image, frame.grid, returns, options=_BRIDGING)
    if not lidar.valid.any():
        return LeftOut(frame.image, "no return of that time lies there")
    return _judged(frame, spc, lidar, shares, options, 0.0)


def sharpened(pair: Pair, options: PairOptions, *, blur_cells: float) -> Pair | LeftOut:
    """Match the bigmaps of a pair again, both brought to one resolution."""
    return _judged(pair.frame, pair.spc, pair.lidar, pair.shares, options, blur_cells)


def _judged(
    frame: PairFrame,
    spc: Maplet,
    lidar: Maplet,
    shares: FloatArray,
    options: PairOptions,
    blur_cells: float,
) -> Pair | LeftOut:
    """Match two bigmaps on ``frame.grid``."""
    match = match_surfaces(
        frame.image,
        frame.grid,
        Surface(lidar.height, lidar.sigma),
        Surface(spc.height, spc.sigma),
        blur_cells=blur_cells,
        options=options.match,
    )
    if not match.usable:
        return LeftOut(frame.image, match.reason)
    return Pair(frame, spc, lidar, match, shares)


def blur_of(pair: Pair) -> float:
    """Blur of the SPC bigmap against the lidar's, cells; NaN where they share too little."""
    return estimate_blur(pair.spc.height - pair.match.residual, pair.spc.height)


def pair_observations(pairs: Sequence[Pair], trajectory: Trajectory) -> ScaleObservations:
    """What the pairs say about the scale: lidar minus SPC surface, body-fixed, metres.

    `trajectory` is the one by which the returns of the pairs were located.

    Raises
    ------
    InvalidValueError
        If there is no pair.
    """
    frames = [pair.frame for pair in pairs]
    kind: Literal["pairs"] = "pairs"
    return ScaleObservations(
        kind=kind,
        label=tuple(frame.image for frame in frames),
        day=tuple(utc_date(frame.time) for frame in frames),
        # The match moves the lidar onto SPC; what is observed is where the lidar lies.
        value=-np.array([pair.match.displacement for pair in pairs]).reshape(-1, 3),
        covariance=np.array([pair.match.covariance for pair in pairs]).reshape(-1, 3, 3),
        point=np.array([frame.grid.center for frame in frames]).reshape(-1, 3),
        beam=np.array([frame.beam for frame in frames]).reshape(-1, 3),
        range=np.array([frame.range for frame in frames]),
        normal=np.array([frame.normal for frame in frames]).reshape(-1, 3),
        local_time_h=np.array([frame.local_time_h for frame in frames]),
        shares=np.array([pair.shares for pair in pairs]).reshape(len(pairs), -1),
        trajectory=trajectory,
    )
