"""Pairs of bigmaps for each image, of SPC maplets and of lidar returns, and their match."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fusion.estimation.verdict import Cause
from fusion.scaling.fit.observation import (
    ScaleObservations,
    TrajectorySource,
    uniform_displacements,
)
from fusion.scaling.geometry.frames import PairFrame, PairOptions, UnpairedImage
from fusion.scaling.geometry.sharing import ground_in_common, patterns, shared_matches
from fusion.surfacematch import Match, Surface, match_surfaces
from fusion.surfacematch.resolution import estimate_blur
from lidar.gridding import LidarBigmapOptions, bigmap_from_returns
from lidar.scans import Returns
from spcola.arrays import FloatArray
from spcola.grids import Maplet
from spcola.navigation import iso_utc


@dataclass(frozen=True, eq=False)
class PairSources:
    """Shared sources of error of the two surfaces of a pair.

    Attributes
    ----------
    scan : str
    states : (S,) ndarray
        Share of each image's state (or each scan) in the positions of the returns.
    response : (S, 3, 3) ndarray
        Displacement of the match per displacement of each, body-fixed.
    maplets : (M,) ndarray
        Share of each maplet of the solution in the SPC bigmap.
    """

    scan: str
    states: FloatArray
    response: FloatArray
    maplets: FloatArray


@dataclass(frozen=True, eq=False)
class Pair:
    """The two bigmaps of an image and their match.

    Attributes
    ----------
    frame : PairFrame
    spc : Maplet
    lidar : Maplet
    match : Match
        Displacement of the lidar surface onto the SPC surface.
    sources : PairSources
    """

    frame: PairFrame
    spc: Maplet
    lidar: Maplet
    match: Match
    sources: PairSources

    def relative_blur(self) -> float:
        """Return the blur of the SPC bigmap relative to the lidar's, cells; NaN if unknown."""
        return estimate_blur(*self.match.on_one_grid(self.lidar.height, self.spc.height))


# A single scan leaves cells empty; gaps of up to two cells are filled.
_BRIDGING = LidarBigmapOptions(max_gap=2)


def make_pair(
    frame: PairFrame, spc: Maplet, returns: Returns, sources: PairSources, options: PairOptions
) -> Pair | UnpairedImage:
    """Grid the returns in the frame of the image and match them to the SPC bigmap.

    Parameters
    ----------
    frame : PairFrame
    spc : Maplet
        The SPC bigmap on ``frame.grid``.
    returns : Returns
        Body-fixed, metres, located by the trajectory under test.
    sources : PairSources
    options : PairOptions

    Returns
    -------
    Pair or UnpairedImage
        The latter with the reason if there is nothing to match, or no match.
    """
    if not spc.valid.any():
        return UnpairedImage(frame.image, Cause.NO_DATA, "no maplet lies there")
    lidar = bigmap_from_returns(frame.image, frame.grid, returns, options=_BRIDGING)
    if not lidar.valid.any():
        return UnpairedImage(frame.image, Cause.NO_DATA, "no return of that time lies there")
    for what, valid in (("maplets", spc.valid), ("returns", lidar.valid)):
        if (share := float(np.mean(valid))) < options.match.min_coverage:
            few = f"{what} cover only {share:.0%} of the square"
            return UnpairedImage(frame.image, Cause.NOT_COVERED, few)
    return _judged(frame, spc, lidar, sources, options, 0.0)


def rematch(pair: Pair, options: PairOptions, *, blur_cells: float) -> Pair | UnpairedImage:
    """Match the bigmaps of a pair again, at a common resolution.

    `blur_cells` is the blur of the SPC bigmap relative to the lidar's; `options` as for
    :func:`make_pair`.
    """
    return _judged(pair.frame, pair.spc, pair.lidar, pair.sources, options, blur_cells)


def _judged(
    frame: PairFrame,
    spc: Maplet,
    lidar: Maplet,
    sources: PairSources,
    options: PairOptions,
    blur_cells: float,
) -> Pair | UnpairedImage:
    """Match two bigmaps on ``frame.grid``."""
    match = match_surfaces(
        frame.image,
        frame.grid,
        Surface(lidar.height, lidar.sigma),
        Surface(spc.height, spc.sigma),
        blur_cells=blur_cells,
        options=options.match,
    )
    if match.cause is not None:
        return UnpairedImage(frame.image, match.cause, match.reason, unmatched=True)
    return Pair(frame, spc, lidar, match, sources)


def pair_observations(
    pairs: Sequence[Pair], trajectory: TrajectorySource, *, center_sigma: FloatArray | None = None
) -> ScaleObservations:
    """Return the observations of pairs: lidar minus SPC surface, body-fixed, metres.

    Parameters
    ----------
    pairs : sequence of Pair
    trajectory : {"spc", "reference"}
        Trajectory by which the returns of the pairs were located.
    center_sigma : (M,) ndarray, optional
        Standard deviation per axis of the centres of the solution's maplets, metres; 0 by default.

    Raises
    ------
    InvalidValueError
        If there is no pair.
    """
    frames = [pair.frame for pair in pairs]
    ground, own = _of_ground(pairs, center_sigma)
    return ScaleObservations(
        kind="pairs",
        label=tuple(frame.image for frame in frames),
        day=tuple(iso_utc(frame.time, 0)[:10] for frame in frames),
        # The match moves the lidar onto SPC; the observation is the position of the lidar.
        value=-np.array([pair.match.displacement for pair in pairs]).reshape(-1, 3),
        covariance=own,
        point=np.array([frame.grid.center for frame in frames]).reshape(-1, 3),
        beam=np.array([frame.beam for frame in frames]).reshape(-1, 3),
        range=np.array([frame.range for frame in frames]),
        normal=np.array([frame.normal for frame in frames]).reshape(-1, 3),
        local_time_h=np.array([frame.local_time_h for frame in frames]),
        shares=np.array([pair.sources.states for pair in pairs]).reshape(len(pairs), -1),
        trajectory=trajectory,
        scan=tuple(pair.sources.scan for pair in pairs),
        response=np.array([pair.sources.response for pair in pairs])
        .transpose(0, 2, 1, 3)
        .reshape(len(pairs), 3, -1),
        ground=ground,
    )


def pair_maplet_shares(pairs: Sequence[Pair]) -> FloatArray:
    """Share (N, M) of each of the solution's M maplets in the SPC bigmaps of N pairs."""
    return np.array([pair.sources.maplets for pair in pairs]).reshape(len(pairs), -1)


def _of_ground(
    pairs: Sequence[Pair], center_sigma: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Shared error patterns (N, 3, K) of pairs over the same ground, and residual covariances."""
    covariance = np.array([pair.match.covariance for pair in pairs]).reshape(-1, 3, 3)
    matches, own = shared_matches(ground_in_common([pair.frame.grid for pair in pairs]), covariance)
    if center_sigma is None:
        return matches, own
    maplets = patterns(uniform_displacements(pair_maplet_shares(pairs) * center_sigma))
    return np.concatenate([maplets, matches], axis=2), own
