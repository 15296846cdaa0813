"""Shots of a scan or track: times, positions, beams."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from lidar.truth.settings import LidarSettings
from lidar.truth.track import NadirTrack
from spcola.arrays import FloatArray
from spcola.truth.body import TruthBody
from spcola.truth.campaign import Pass

# Uniform numbers of a shot, whatever happens to it: place (2), fate, range, outlier, intensity.
# Their number is fixed, so that a scan does not depend on its division into chunks.
DEVIATES = 6
_PLACE = slice(0, 2)
_NEAR_AXIS = 0.99


@dataclass(frozen=True, eq=False)
class Shots:
    """True shots of a chunk, N of them.

    Attributes
    ----------
    time : (N,) ndarray
        Ephemeris time, s.
    spacecraft : (N, 3) ndarray
        Body-fixed, metres.
    beam : (N, 3) ndarray
        Unit vectors, body-fixed.
    along, across : (3,) or (N, 3) ndarray
        Unit vectors on the ground, the directions of pointing errors.
    gap : float
        Approximate distance from the spacecraft to the ground, metres.
    deviates : (N, K) ndarray
        Uniform random numbers of each shot.
    """

    time: FloatArray
    spacecraft: FloatArray
    beam: FloatArray
    along: FloatArray
    across: FloatArray
    gap: float
    deviates: FloatArray

    def __len__(self) -> int:
        return len(self.time)

    def normal(self, column: int) -> FloatArray:
        """Return normal deviates (N,) computed from a column of uniform ones."""
        # Uniform numbers may be 0, whose normal quantile is infinite.
        return np.asarray(ndtri(np.maximum(self.deviates[:, column], 1e-16)), dtype=np.float64)


def raster_shots(
    body: TruthBody,
    at: Pass,
    settings: LidarSettings,
    generator: np.random.Generator,
    chunk: int,
) -> Iterator[Shots]:
    """Yield the shots of a raster, at most `chunk` at once.

    The raster lies on a plane across the line of sight, through the ground below the middle of
    the pass. Lines are swept to and fro; each shot falls at a random place in its own square, so
    that no grid can resonate with it.
    """
    toward = at.position(np.array([at.middle]))[0] / at.distance
    along, across = _sides(toward)
    ground = float(body.outermost_radius(toward[None])[0])
    lines = settings.lines
    for number, deviates in _numbered(lines**2, generator, chunk):
        v, u = np.divmod(number, lines)
        u = np.where(v % 2 == 1, lines - 1 - u, u)
        place = (np.stack([u, v], axis=1) + deviates[:, _PLACE]) / lines - 0.5
        aim = ground * toward + settings.width * place @ np.stack([along, across])
        time = at.start + at.duration * (number + 0.5) / lines**2
        spacecraft = at.position(time)
        beam = unit(aim - spacecraft)
        yield Shots(time, spacecraft, beam, along, across, at.distance - ground, deviates)


def track_shots(
    body: TruthBody, at: NadirTrack, generator: np.random.Generator, chunk: int
) -> Iterator[Shots]:
    """Yield the shots of a nadir track, toward O, at most `chunk` at once."""
    for number, deviates in _numbered(at.shots, generator, chunk):
        time = at.start + number / at.rate
        spacecraft = at.position(time)
        beam = unit(-spacecraft)
        # Half a second either way: short against an orbit, and long enough for the difference.
        motion = at.position(time + 0.5) - at.position(time - 0.5)
        along = unit(motion - np.sum(motion * beam, axis=1)[:, None] * beam)
        across = np.cross(along, beam)
        gap = at.distance - body.settings.radius
        yield Shots(time, spacecraft, beam, along, across, gap, deviates)


def unit(vectors: FloatArray) -> FloatArray:
    """Return `vectors` (N, 3) scaled to length 1."""
    scaled: FloatArray = vectors / np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None]
    return scaled


def _sides(toward: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the unit vectors of a raster seen from `toward` (3,): east and north off the poles."""
    pole = np.array([0.0, 0.0, 1.0] if abs(toward[2]) < _NEAR_AXIS else [1.0, 0.0, 0.0])
    along = np.cross(pole, toward)
    along /= np.linalg.norm(along)
    return along, np.cross(toward, along)


def _numbered(
    count: int, generator: np.random.Generator, chunk: int
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield numbers (N,) from 0 and their deviates (N, K), in chunks."""
    for start in range(0, count, chunk):
        number = np.arange(start, min(start + chunk, count), dtype=np.float64)
        yield number, generator.random((len(number), DEVIATES))
