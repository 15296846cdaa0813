"""Line-scan and rolling-shutter images: one state for each line."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray, IntArray, check_finite, frozen
from spcola.camera.camera import Camera
from spcola.camera.projection import project_vectors, view_vectors
from spcola.errors import InvalidValueError

# Lines at which a point's miss is first evaluated; between two of them it crosses zero once.
_NODES = 129
_MAX_STEPS = 60
_LINE_TOLERANCE = 1e-9
_POINTS_AT_ONCE = 1024


@dataclass(frozen=True, eq=False)
class LineScan:
    """An image whose lines were exposed one after the other.

    Parameters
    ----------
    camera : Camera
        Interior orientation of the detector. For a line scanner its only line is line 1, and
        `camera.height` is 1.
    times : (L,) array_like
        Ephemeris times of the lines' mid-exposures, s, all increasing or all decreasing.
    positions : (L, 3) array_like
        Of the pupil at these times, body-fixed, metres.
    axes : (L, 3, 3) array_like
        Rows Cx, Cy, Cz at these times, body-fixed.
    shutter : {"line", "rolling"}
        "line": every line of the image is the detector's line 1. "rolling": line l of the image
        is line l of the detector.

    Raises
    ------
    InvalidValueError
        If there are fewer than two lines, shapes differ, the times do not run one way, or the
        axes are not orthonormal and right-handed.
    """

    camera: Camera
    times: FloatArray
    positions: FloatArray
    axes: FloatArray
    shutter: Literal["line", "rolling"] = "line"

    def __post_init__(self) -> None:
        times = frozen(self.times, (None,), "line scan: times")
        count = len(times)
        object.__setattr__(self, "times", times)
        for name, shape in (("positions", (count, 3)), ("axes", (count, 3, 3))):
            array = frozen(getattr(self, name), shape, f"line scan: {name}")
            check_finite(array, f"line scan: {name}")
            object.__setattr__(self, name, array)
        if count < 2:
            raise InvalidValueError(f"has {count} lines, two at least are needed", "line scan")
        steps = np.diff(times)
        if not (np.all(steps > 0) or np.all(steps < 0)):
            raise InvalidValueError("times of the lines do not run one way", "line scan")
        gram = np.einsum("nij,nkj->nik", self.axes, self.axes)
        if np.max(np.abs(gram - np.eye(3))) > 1e-5 or np.any(np.linalg.det(self.axes) < 0):
            raise InvalidValueError("axes are not orthonormal and right-handed", "line scan")
        if self.shutter == "rolling" and self.camera.height != count:
            raise InvalidValueError(
                f"{count} lines, and a detector of {self.camera.height}", "line scan"
            )

    @property
    def height(self) -> int:
        """Number of lines."""
        return len(self.times)

    @cached_property
    def _turns(self) -> FloatArray:
        """Rotation vectors (L−1, 3) from each line's axes to the next, radians."""
        turn = self.axes[1:] @ np.swapaxes(self.axes[:-1], -1, -2)
        vectors: FloatArray = Rotation.from_matrix(turn).as_rotvec()
        return vectors

    def state_at(self, line: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return positions (…, 3), m, and axes (…, 3, 3) at lines (…), which need not be whole.

        Straight lines between positions and turns at a constant rate between axes. Half a line
        before the first and after the last is extrapolated.

        Parameters
        ----------
        line : (…) array_like
            From 1 in the middle of the first line.
        """
        wanted = np.asarray(line, dtype=np.float64)
        flat = np.nan_to_num(wanted.ravel(), nan=1.0) - 1.0
        low = np.clip(np.floor(flat).astype(int), 0, self.height - 2)
        share = (flat - low)[:, None]
        place = self.positions[low] + share * (self.positions[low + 1] - self.positions[low])
        turn = Rotation.from_rotvec(share * self._turns[low]).as_matrix()
        return place.reshape(*wanted.shape, 3), (turn @ self.axes[low]).reshape(*wanted.shape, 3, 3)


@dataclass(frozen=True, eq=False)
class ScannedPoints:
    """Where points lie in a line-scan image.

    Parameters
    ----------
    pixel, line : (…) ndarray
        From (1, 1) in the middle of the first pixel of the first line; NaN where the point was
        never in view between the first line and the last. A pixel may lie beyond the detector's
        ends.
    crossings : (…) ndarray of int
        How often the point crossed the detector's line; pixel and line are those of the first. More
        than one where the camera swept back.
    """

    pixel: FloatArray
    line: FloatArray
    crossings: IntArray


def project_scan(scan: LineScan, points: ArrayLike) -> ScannedPoints:
    """Return pixel and line of body-fixed points (…, 3), metres, in a line-scan image.

    The line solves ``l(camera at that line) = l(detector)``: signs of the difference on 129 lines
    bracket it, the secant method with bisection refines it to 1e-9 of a line.

    Parameters
    ----------
    scan : LineScan
    points : (…, 3) array_like
    """
    places = np.asarray(points, dtype=np.float64)
    flat = places.reshape(-1, 3)
    line, crossings = np.full(len(flat), np.nan), np.zeros(len(flat), dtype=int)
    for start in range(0, len(flat), _POINTS_AT_ONCE):
        part = slice(start, start + _POINTS_AT_ONCE)
        line[part], crossings[part] = _lines_of(scan, flat[part])
    pixel, _ = _seen(scan, flat, line)
    pixel[np.isnan(line)] = np.nan
    shape = places.shape[:-1]
    return ScannedPoints(pixel.reshape(shape), line.reshape(shape), crossings.reshape(shape))


def scan_rays(scan: LineScan, pixel: ArrayLike, line: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return origins (…, 3), metres, and unit vectors (…, 3) of rays through pixel and line (…).

    Body-fixed. The inverse of `project_scan`; NaN outside the lines of the image and where the
    distortion cannot be inverted.

    Parameters
    ----------
    scan : LineScan
    pixel, line : (…) array_like
        From (1, 1) in the middle of the first pixel of the first line.
    """
    pixels, lines = np.broadcast_arrays(np.asarray(pixel, float), np.asarray(line, float))
    origins, axes = scan.state_at(lines)
    on_detector = lines if scan.shutter == "rolling" else np.ones_like(lines)
    seen = view_vectors(scan.camera, pixels, on_detector)
    directions: FloatArray = np.einsum("...i,...ij->...j", seen, axes)
    outside = ~((lines >= 0.5) & (lines <= scan.height + 0.5))
    origins[outside], directions[outside] = np.nan, np.nan
    return origins, directions


def _seen(scan: LineScan, points: FloatArray, line: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the pixel of points (…, 3) at lines (…), and how far they are from the line's."""
    places, axes = scan.state_at(line)
    return _missed(scan, np.einsum("...ij,...j->...i", axes, points - places), line)


def _missed(scan: LineScan, vectors: FloatArray, line: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pixel and miss, in lines, of vectors (…, 3) in the camera's axes at lines (…)."""
    pixel, on_detector = project_vectors(scan.camera, vectors)
    return pixel, on_detector - (line if scan.shutter == "rolling" else 1.0)


def _lines_of(scan: LineScan, points: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the first line (N,) at which each point is on the detector's line, and how many."""
    nodes = np.linspace(0.5, scan.height + 0.5, min(_NODES, 2 * scan.height + 1))
    places, axes = scan.state_at(nodes)
    vectors = np.einsum("kij,nkj->nki", axes, points[:, None] - places, optimize=True)
    _, miss = _missed(scan, vectors, nodes)
    with np.errstate(invalid="ignore"):
        # A node that is hit exactly belongs to the interval after it.
        cross = (miss[:, :-1] * miss[:, 1:] < 0) | (miss[:, :-1] == 0)
        cross[:, -1] |= miss[:, -1] == 0
    crossings = np.count_nonzero(cross, axis=1)
    first = np.argmax(cross, axis=1)
    line = np.full(len(points), np.nan)
    hit = np.flatnonzero(crossings)
    low, high = nodes[first[hit]], nodes[first[hit] + 1]
    ends = miss[hit, first[hit]], miss[hit, first[hit] + 1]
    line[hit] = _refine(scan, points[hit], (low, high), ends)
    return line, crossings


def _refine(
    scan: LineScan,
    points: FloatArray,
    bracket: tuple[FloatArray, FloatArray],
    ends: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Return the root (N,) between two lines: false position with halving (Illinois)."""
    low, high = bracket[0].copy(), bracket[1].copy()
    at_low, at_high = ends[0].copy(), ends[1].copy()
    line = low.copy()
    for _ in range(_MAX_STEPS):
        with np.errstate(invalid="ignore", divide="ignore"):
            new = high - at_high * (high - low) / (at_high - at_low)
        new = np.where(np.isfinite(new), np.clip(new, low, high), 0.5 * (low + high))
        moved, line = np.abs(new - line), new
        _, miss = _seen(scan, points, line)
        same = np.sign(miss) == np.sign(at_low)
        # The end that stays is halved, or false position would keep it for ever.
        at_high = np.where(same, 0.5 * at_high, miss)
        at_low = np.where(same, miss, 0.5 * at_low)
        low, high = np.where(same, line, low), np.where(same, high, line)
        if not np.any((moved > _LINE_TOLERANCE) & (miss != 0)):
            break
    return line
