"""The returns of a whole mission: asked for by place, read from the scans' own files.

Each scan lies in a file of its own, sorted by place (:mod:`lidar.formats.native`): adding a scan
or replacing one touches no other. What lies around a mapola is picked from the cubes near it; a
mission has more returns than memory, and no more than those are ever unpacked.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lidar.cubes import CubedPoints, near, unpack_near
from lidar.formats.blocks import Block, times_of
from lidar.formats.native import ScanFile
from lidar.relocation import Relocation
from lidar.returns import Returns
from spcola.arrays import FloatArray, IntArray, frozen
from spcola.errors import InvalidValueError
from spcola.kernel import kernel


class ScanStore:
    """Returns of many native scans; usable from several threads.

    Parameters
    ----------
    paths : sequence of paths
        Native scans, of one body-fixed frame.
    locate : callable, optional
        Says how a scan's returns are located again; they stay where they are if not given.

    Attributes
    ----------
    scan_names : tuple of str
    middles : (S, 3) ndarray
        Middle of the box that holds each scan as it was located at first, metres; 0 for one
        without returns.
    without_place : mapping of str to int
        By scan, how many returns have no place where they should be located again.

    Raises
    ------
    FormatError
        If a file is no whole native scan.
    InvalidValueError
        If scans lie in different body-fixed frames, or two bear one name.
    """

    def __init__(
        self,
        paths: Sequence[str | Path],
        *,
        locate: Callable[[ScanFile], Relocation] | None = None,
    ) -> None:
        self._paths, self._locate = tuple(paths), locate
        files = [ScanFile(path) for path in paths]
        summaries = [file.summary for file in files]
        self.scan_names = tuple(summary.name for summary in summaries)
        if len(set(self.scan_names)) < len(files):
            twice = next(n for n in self.scan_names if self.scan_names.count(n) > 1)
            raise InvalidValueError("two scans bear this name", twice, "import one under another")
        bodies = sorted({summary.body for summary in summaries})
        if len(bodies) > 1:
            raise InvalidValueError(f"lie in different frames: {', '.join(bodies)}", "scans")
        self.middles = np.array([_middle(s.bounds) for s in summaries]).reshape(-1, 3)
        moves = [locate(file) if locate else None for file in files]
        self._blocks = [
            _Part(number, block, block.cubes, moves[number])
            for number, file in enumerate(files)
            for block in file.blocks
        ]
        self.without_place = dict.fromkeys(self.scan_names, 0)
        for part in self._blocks:
            self.without_place[self.scan_names[part.scan]] += part.without_place()
        spheres = [part.sphere for part in self._blocks]
        self._middle = np.array([middle for middle, _ in spheres]).reshape(-1, 3)
        self._radius = np.array([radius for _, radius in spheres])

    def __reduce__(self) -> tuple[Callable[..., ScanStore], tuple[Any, ...]]:
        # Another process maps the files itself.
        return _opened, (self._paths, self._locate)

    def __len__(self) -> int:
        return sum(len(part.cubes.place) for part in self._blocks)

    @property
    def cubes(self) -> int:
        """Number of cubes that hold returns."""
        return sum(len(part.cubes.cube) for part in self._blocks)

    def count_near(self, center: ArrayLike, radius: float) -> int:
        """Count the returns in the cubes that reach within `radius` of `center` (3,), metres.

        As many as :meth:`returns_near` unpacks, somewhat more than it returns.
        """
        center = frozen(center, (3,), "center")
        apart = np.linalg.norm(self._middle - center, axis=1)
        return sum(
            self._blocks[number].count_near(center, radius)
            for number in np.flatnonzero(apart <= radius + self._radius)
        )

    def returns_near(self, center: ArrayLike, radius: float) -> Returns:
        """Return all returns within `radius` of `center` (3,), metres.

        They come in the order of the scans, in each by cube.
        """
        center = frozen(center, (3,), "center")
        apart = np.linalg.norm(self._middle - center, axis=1)
        found = []
        for number in np.flatnonzero(apart <= radius + self._radius):
            part = self._blocks[number]
            points, rows = part.near(center, radius)
            if len(rows):
                found.append((part, points, rows))
        return Returns(
            np.concatenate([np.empty((0, 3)), *(points for _, points, _ in found)]),
            np.concatenate([np.empty(0), *(part.sigmas(rows) for part, _, rows in found)]),
            np.concatenate(
                [
                    np.empty(0, dtype=np.int32),
                    *(np.full(len(rows), part.scan, dtype=np.int32) for part, _, rows in found),
                ]
            ),
            self.scan_names,
        )


def _opened(
    paths: Sequence[str | Path], locate: Callable[[ScanFile], Relocation] | None
) -> ScanStore:
    return ScanStore(paths, locate=locate)


@dataclass(frozen=True, eq=False)
class _Part:
    """A block of a scan, as far as gridding asks for it."""

    scan: int
    block: Block
    cubes: CubedPoints
    move: Relocation | None

    @property
    def sphere(self) -> tuple[FloatArray, float]:
        """A sphere that holds all returns: its middle (3,) and its radius, metres."""
        middles = self.cubes.middle
        center = (middles.min(axis=0) + middles.max(axis=0)) / 2.0
        away = float(np.linalg.norm(middles - center, axis=1).max())
        return center, away + self.cubes.reach + self.reach

    @cached_property
    def reach(self) -> float:
        """By how much returns are moved at most, metres."""
        if self.move is None:
            return 0.0
        radius = float(np.linalg.norm(self.cubes.middle, axis=1).max()) + self.cubes.reach
        return self.move.reach(radius)

    def near(self, center: FloatArray, radius: float) -> tuple[FloatArray, IntArray]:
        """Points (M, 3) within `radius` of `center`, where they are now, and their rows (M,)."""
        wide = radius + self.reach
        points, rows = unpack_near(self.cubes, near(self.cubes, center, wide), center, wide)
        if self.move is None or not len(rows):
            return points, rows
        points, _ = self.move.apply(points, times_of(self.block, rows))
        count = _keep_near(points, rows, center, radius)
        return points[:count], rows[:count]

    def count_near(self, center: FloatArray, radius: float) -> int:
        """Count the returns in the cubes that are looked into for :meth:`near`."""
        chosen = near(self.cubes, center, radius + self.reach)
        return int((self.cubes.start[chosen + 1] - self.cubes.start[chosen]).sum())

    def without_place(self) -> int:
        """Count the returns that are at times at which nothing says where they were."""
        if self.move is None:
            return 0
        time = times_of(self.block)
        return int(np.count_nonzero(~self.move.apply(np.zeros((len(time), 3)), time)[1]))

    def sigmas(self, rows: IntArray) -> FloatArray:
        """Sigma of single returns, metres; NaN where unknown."""
        sigma = self.block.layers.get("sigma")
        if sigma is None:
            return np.full(len(rows), self.block.numbers.get("sigma", np.nan))
        return sigma[rows].astype(np.float64)


@kernel
def _keep_near(points: FloatArray, rows: IntArray, center: FloatArray, radius: float) -> int:
    """Move what lies within `radius` of `center` to the front, in its order; return how many.

    What has no place (NaN) lies nowhere near.
    """
    count = 0
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        square = (x - center[0]) ** 2 + (y - center[1]) ** 2 + (z - center[2]) ** 2
        points[count, 0], points[count, 1], points[count, 2] = x, y, z
        rows[count] = rows[n]
        count += square <= radius * radius
    return count


def _middle(bounds: FloatArray) -> FloatArray:
    middle: FloatArray = np.nan_to_num(bounds.mean(axis=0))
    return middle
