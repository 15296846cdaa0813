"""The returns of a whole mission: asked for by place, read from the scans' own files.

Each scan lies in a file of its own, sorted by place (:mod:`lidar.formats.native`): adding a scan
or replacing one touches no other. What lies around a mapola is picked from the cubes near it; a
mission has more returns than memory, and no more than those are ever unpacked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from lidar.cubes import CubedPoints, near, unpack_near
from lidar.formats.native import ScanFile
from lidar.returns import Returns
from spcola.arrays import AnyArray, FloatArray, frozen
from spcola.errors import InvalidValueError


class ScanStore:
    """Returns of many native scans; usable from several threads.

    Parameters
    ----------
    paths : sequence of paths
        Native scans, of one body-fixed frame.

    Attributes
    ----------
    scan_names : tuple of str
    middles : (S, 3) ndarray
        Middle of the box that holds each scan, metres; 0 for one without returns.

    Raises
    ------
    FormatError
        If a file is no whole native scan.
    InvalidValueError
        If scans lie in different body-fixed frames, or two bear one name.
    """

    def __init__(self, paths: Sequence[str | Path]) -> None:
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
        self._blocks = [
            _Part(
                number, block.cubes, block.layers.get("sigma"), block.numbers.get("sigma", np.nan)
            )
            for number, file in enumerate(files)
            for block in file.blocks
        ]
        spheres = [part.sphere for part in self._blocks]
        self._middle = np.array([middle for middle, _ in spheres]).reshape(-1, 3)
        self._radius = np.array([radius for _, radius in spheres])

    def __len__(self) -> int:
        return sum(len(part.cubes.place) for part in self._blocks)

    def returns_near(self, center: ArrayLike, radius: float) -> Returns:
        """Return all returns within `radius` of `center` (3,), metres.

        They come in the order of the scans, in each by cube.
        """
        center = frozen(center, (3,), "center")
        apart = np.linalg.norm(self._middle - center, axis=1)
        found = []
        for number in np.flatnonzero(apart <= radius + self._radius):
            part = self._blocks[number]
            chosen = near(part.cubes, center, radius)
            if len(chosen):
                found.append((part, *unpack_near(part.cubes, chosen, center, radius)))
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


@dataclass(frozen=True, eq=False)
class _Part:
    """A block of a scan, as far as gridding asks for it."""

    scan: int
    cubes: CubedPoints
    sigma: AnyArray | None
    usual_sigma: float

    @property
    def sphere(self) -> tuple[FloatArray, float]:
        """A sphere that holds all cubes: its middle (3,) and its radius, metres."""
        middles = self.cubes.middle
        center = (middles.min(axis=0) + middles.max(axis=0)) / 2.0
        away = float(np.linalg.norm(middles - center, axis=1).max())
        return center, away + self.cubes.reach

    def sigmas(self, rows: AnyArray) -> FloatArray:
        """Sigma of single returns, metres; NaN where unknown."""
        if self.sigma is None:
            return np.full(len(rows), self.usual_sigma)
        return self.sigma[rows].astype(np.float64)


def _middle(bounds: FloatArray) -> FloatArray:
    middle: FloatArray = np.nan_to_num(bounds.mean(axis=0))
    return middle
