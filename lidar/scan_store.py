"""The returns of a whole mission, read by place from the scans' own files.

Each scan has a file of its own, sorted by place (:mod:`lidar.formats.native.scan_file`): adding or
replacing a scan changes no other file. The returns around a mapola are read from the cubes near it;
only these are unpacked, since a mission has more returns than memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from lidar.adjustment import RigidArcs
from lidar.formats.native import Block, ScanFile, times_of
from lidar.geolocation import Geolocation
from lidar.scans import Arcs, Returns
from lidar.scans.cubes import Box, CubedPoints, keep_inside, touching_cubes, unpack_inside
from spcola.arrays import FloatArray, IntArray
from spcola.errors import InvalidValueError

__all__ = ["ScanStore"]

_DAY_S = 86400.0
# Reading one cube maps the pages around it too: so many bytes of a file.
_MAPPED_BYTES = 1 << 16
# Most bytes of mapped files: a mission's exceed the memory of a machine.
_MOST_MAPPED_BYTES = 1 << 29


class ScanStore:
    """Returns of many native scans; usable from several threads.

    Parameters
    ----------
    paths : sequence of paths
        Native scans, of one body-fixed frame.
    locate : callable, optional
        Returns how a scan's returns are located again; by default they are unchanged.
    arc_s : float
        Scans that last longer are cut into arcs of at most so many seconds, each of which counts
        as a scan.

    Attributes
    ----------
    scan_names : tuple of str
        Names of the scans, or of their arcs (:meth:`lidar.scans.Arcs.names`).
    arcs : RigidArcs
        Their centres: the middle of the box of a scan as first located, or the mean of the
        returns of an arc, metres, 0 for one without returns; the scan; and its day.
    without_place : mapping of str to int
        By scan, number of returns without a place after relocation.

    Raises
    ------
    FormatError
        If a file is no whole native scan.
    InvalidValueError
        If scans lie in different body-fixed frames, or two have the same name.
    """

    def __init__(
        self,
        paths: Sequence[str | Path],
        *,
        locate: Callable[[ScanFile], Geolocation] | None = None,
        arc_s: float = np.inf,
    ) -> None:
        self._paths, self._locate, self._arc_s = tuple(paths), locate, arc_s
        files = [ScanFile(path) for path in paths]
        summaries = [file.summary for file in files]
        names = [summary.name for summary in summaries]
        if len(set(names)) < len(files):
            twice = next(name for name in names if names.count(name) > 1)
            same = [str(path) for path, name in zip(paths, names, strict=True) if name == twice]
            raise InvalidValueError(
                f"is the scan of two files ({' and '.join(same)})", twice, "remove one of them"
            )
        bodies = sorted({summary.body for summary in summaries})
        if len(bodies) > 1:
            raise InvalidValueError(f"lie in different frames: {', '.join(bodies)}", "scans")
        self._blocks: list[_Part] = []
        self._files, self._mapped = files, 0
        self.without_place: dict[str, int] = {}
        self.scan_names: tuple[str, ...] = ()
        self.arcs = RigidArcs.whole(np.empty((0, 3)))
        for file in files:
            self._add(file, locate(file) if locate else None)
            file.release()
        spheres = [part.sphere for part in self._blocks]
        self._middle = np.array([middle for middle, _ in spheres]).reshape(-1, 3)
        self._radius = np.array([radius for _, radius in spheres])

    def _add(self, file: ScanFile, move: Geolocation | None) -> None:
        """Append the blocks of a scan, and its arcs."""
        arcs, first = Arcs.of_span(file.summary.time_span, self._arc_s), len(self.scan_names)
        parts = [_Part(first, block, block.cubes, move, arcs) for block in file.blocks]
        middle = np.nan_to_num(file.summary.bounds.mean(axis=0))
        middles = middle[None] if arcs.count == 1 else _means(parts, arcs)
        self._blocks += parts
        self.scan_names += tuple(arcs.names(file.summary.name))
        number, before = len(self.without_place), self.arcs
        self.arcs = RigidArcs(
            np.vstack([before.center, middles]),
            np.append(before.scan, np.full(arcs.count, number)),
            np.append(before.day, np.full(arcs.count, _day(file.summary.time_span))),
        )
        self.without_place[file.summary.name] = sum(part.without_place() for part in parts)

    def __reduce__(self) -> tuple[Callable[..., ScanStore], tuple[Any, ...]]:
        # Another process maps the files itself.
        return partial(ScanStore, locate=self._locate, arc_s=self._arc_s), (self._paths,)

    def __len__(self) -> int:
        return sum(len(part.cubes.place) for part in self._blocks)

    @property
    def cubes(self) -> int:
        """Number of occupied cubes."""
        return sum(len(part.cubes.cube) for part in self._blocks)

    @property
    def interpolation_error_m(self) -> float:
        """Largest error of returns geolocated again due to interpolation, metres.

        See :attr:`lidar.geolocation.Geolocation.error_m`.
        """
        return max((part.move.error_m for part in self._blocks if part.move), default=0.0)

    def count_inside(self, box: Box) -> int:
        """Count the returns in the cubes that reach into `box`.

        Counts the returns that :meth:`returns_inside` unpacks, somewhat more than it returns.
        """
        return sum(part.touching(box)[1] for part in self._touching(box))

    def returns_inside(self, box: Box) -> Returns:
        """Return all returns inside `box`, in the order of the scans, in each by cube."""
        parts = [(part, part.touching(box)) for part in self._touching(box)]
        room = sum(total for _, (_, total) in parts)
        # Parts write one after the other into one array: joining would copy it all.
        points, sigma = np.empty((room, 3)), np.empty(room)
        rows, scan = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int32)
        count = 0
        for part, (chosen, _) in parts:
            end = count + part.unpack(chosen, box, points[count:], rows[count:])
            sigma[count:end] = part.sigmas(rows[count:end])
            scan[count:end] = part.scans(rows[count:end])
            count = end
        self._note(sum(len(chosen) for _, (chosen, _) in parts))
        return Returns(points[:count], sigma[:count], scan[:count], self.scan_names)

    def spread(self, most: int) -> FloatArray:
        """Return about `most` returns (N, 3), metres, spread over all scans and their areas."""
        every = max(1, -(-len(self) // most))
        found = [part.every(every) for part in self._blocks]
        for file in self._files:
            file.release()
        return np.concatenate([np.empty((0, 3)), *found])

    def _note(self, cubes: int) -> None:
        """Count the cubes read, and unmap files before they take too much memory."""
        # Threads may lose some of each other's counts: no more than a few mapolas.
        self._mapped += cubes * _MAPPED_BYTES
        if self._mapped > _MOST_MAPPED_BYTES:
            self._mapped = 0
            for file in self._files:
                file.release()

    def _touching(self, box: Box) -> list[_Part]:
        return [self._blocks[k] for k in np.flatnonzero(box.touches(self._middle, self._radius))]


@dataclass(frozen=True, eq=False)
class _Part:
    """A block of a scan as used by gridding; `scan` is the number of its first arc."""

    scan: int
    block: Block
    cubes: CubedPoints
    move: Geolocation | None
    arcs: Arcs

    @property
    def sphere(self) -> tuple[FloatArray, float]:
        """A sphere that contains all returns: its middle (3,) and its radius, metres."""
        middles = self.cubes.middle
        center = (middles.min(axis=0) + middles.max(axis=0)) / 2.0
        away = float(np.linalg.norm(middles - center, axis=1).max())
        return center, away + self.cubes.reach + self.reach

    @cached_property
    def reach(self) -> float:
        """Largest displacement of the returns, metres."""
        if self.move is None:
            return 0.0
        radius = float(np.linalg.norm(self.cubes.middle, axis=1).max()) + self.cubes.reach
        return self.move.reach(radius)

    def touching(self, box: Box) -> tuple[IntArray, int]:
        """Cubes (numbers) that may have relocated returns inside `box`, and the returns in them."""
        return touching_cubes(self.cubes, box, self.reach)

    def unpack(self, chosen: IntArray, box: Box, points: FloatArray, rows: IntArray) -> int:
        """Write relocated returns in `box` to the front of `points` and `rows`; return how many.

        Only the `chosen` cubes are searched.
        """
        count = unpack_inside(self.cubes, chosen, box, points, rows, reach=self.reach)
        if self.move is None or not count:
            return count
        points[:count], _ = self.move.apply(points[:count], times_of(self.block, rows[:count]))
        return keep_inside(points[:count], rows[:count], box)

    def every(self, step: int) -> FloatArray:
        """Every `step`-th return (N, 3) that has a place, metres."""
        rows = np.arange(0, len(self.cubes.place), step)
        points = self.cubes.points_at(rows)
        if self.move is None:
            return points
        moved, kept = self.move.apply(points, times_of(self.block, rows))
        return moved[kept]

    def without_place(self) -> int:
        """Count the returns at times without a known position."""
        if self.move is None:
            return 0
        return int(np.count_nonzero(~self.move.covers(times_of(self.block))))

    def scans(self, rows: IntArray) -> IntArray | int:
        """Numbers of the scans, or arcs, of single returns."""
        if self.arcs.count == 1:
            return self.scan
        return self.scan + self.arcs.numbers(times_of(self.block, rows))

    def sigmas(self, rows: IntArray) -> FloatArray | float:
        """Sigma of single returns, or of all of them, metres; NaN where unknown."""
        sigma = self.block.layers.get("sigma")
        if sigma is None:
            return self.block.numbers.get("sigma", np.nan)
        return sigma[rows]


def _day(span: tuple[float, float]) -> int:
    """Number of the day of the middle of a span; −1 where it is unknown."""
    middle = (span[0] + span[1]) / 2.0
    # Ephemeris time begins at noon.
    return int((middle + _DAY_S / 2.0) // _DAY_S) if np.isfinite(middle) else -1


def _means(parts: Sequence[_Part], arcs: Arcs) -> FloatArray:
    """Mean (K, 3) of the returns of each of a scan's arcs, metres; 0 for one without."""
    total = np.zeros((arcs.count, 4))
    for part in parts:
        number = arcs.numbers(times_of(part.block))
        points = part.cubes.points()
        np.add.at(total, number, np.column_stack([points, np.ones(len(points))]))
    means: FloatArray = total[:, :3] / np.maximum(total[:, 3:], 1.0)
    return means
