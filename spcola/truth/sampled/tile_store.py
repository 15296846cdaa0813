"""Tiles of a function of direction, computed when needed, the least recently used dropped first."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.errors import SettingsError
from spcola.truth.sampled.cube import Tiling, fill_tile, look_up, tile_directions, tiles_of

_NODES_AT_ONCE = 1 << 19
_CHUNK = 1 << 15


class TileStore:
    """Values of a function on the tiles of a cube; safe to use from several threads at once.

    Reading tiles requires a lease on them: a leased tile is not moved. All tiles of a lease are
    granted at once, so that two leases that exceed the memory together take turns.

    Parameters
    ----------
    field : callable
        Takes unit vectors (N, 3), returns values (N,).
    tiling : Tiling
    memory_bytes : int
        Largest memory of all tiles.
    """

    def __init__(
        self, field: Callable[[FloatArray], FloatArray], tiling: Tiling, *, memory_bytes: int
    ) -> None:
        self.tiling = tiling
        self.capacity = int(min(memory_bytes // (4 * tiling.length), tiling.total))
        if self.capacity < 1:
            raise SettingsError(
                f"{memory_bytes} bytes hold no tile of {4 * tiling.length}", "memory of tiles"
            )
        self.slots: IntArray = np.full(tiling.total, -1, dtype=np.int32)
        self.lower = np.full(tiling.total, -np.inf)
        self.upper = np.full(tiling.total, np.inf)
        # The system allocates memory page by page as tiles are written.
        self.pool: FloatArray = np.empty((self.capacity, tiling.length), dtype=np.float32)
        self.made = 0
        self._field = field
        self._holder: IntArray = np.full(self.capacity, -1, dtype=np.int64)
        self._used: IntArray = np.zeros(self.capacity, dtype=np.int64)
        self._leases: IntArray = np.zeros(tiling.total, dtype=np.int64)
        self._place: IntArray = np.full(tiling.total, -1, dtype=np.int64)
        self._leased = 0
        self._clock = 0
        self._change = threading.Condition()

    @contextmanager
    def lease(self, tiles: IntArray) -> Iterator[None]:
        """Keep `tiles` (distinct numbers, at most `capacity`) in the pool; make missing ones."""
        if len(tiles) > self.capacity:
            raise SettingsError(
                f"{len(tiles)} tiles are needed at once, there is room for {self.capacity}",
                "memory of tiles",
                "give it more, or a wider spacing",
            )
        self._take(tiles)
        try:
            self._ensure(tiles)
            yield
        finally:
            with self._change:
                self._leases[tiles] -= 1
                self._leased -= int(np.count_nonzero(self._leases[tiles] == 0))
                self._change.notify_all()

    def at(self, directions: FloatArray) -> FloatArray:
        """Return the interpolated values (N,) in unit `directions` (N, 3)."""
        out = np.empty(len(directions))
        for first in range(0, len(out), _CHUNK):
            self._look(directions[first : first + _CHUNK], out[first : first + _CHUNK])
        return out

    def _look(self, directions: FloatArray, out: FloatArray) -> None:
        """Fill `out` (N,) with the values in `directions`, by halves if memory is short."""
        wanted = np.zeros(self.tiling.total, dtype=np.bool_)
        tiles_of(self.tiling, directions, wanted)
        tiles = np.flatnonzero(wanted)
        if len(tiles) > self.capacity:
            half = len(out) // 2
            self._look(directions[:half], out[:half])
            self._look(directions[half:], out[half:])
            return
        with self.lease(tiles):
            look_up(self.tiling, self.slots, self.pool, directions, out)

    def _take(self, tiles: IntArray) -> None:
        """Count a lease on each of the tiles, as soon as all fit."""
        with self._change:
            while True:
                fresh = int(np.count_nonzero(self._leases[tiles] == 0))
                if self._leased + fresh <= self.capacity:
                    break
                self._change.wait()
            self._leases[tiles] += 1
            self._leased += fresh
            self._clock += 1

    def _ensure(self, tiles: IntArray) -> None:
        """Compute missing leased tiles, or wait for the thread that computes them."""
        while True:
            with self._change:
                missing = tiles[self._place[tiles] < 0]
                self._assign(missing)
                present = self._place[tiles]
                self._used[present] = self._clock
            if len(missing):
                self._make(missing)
            with self._change:
                while np.any((self.slots[tiles] < 0) & (self._place[tiles] >= 0)):
                    self._change.wait()
                if not np.any(self.slots[tiles] < 0):
                    return

    def _assign(self, tiles: IntArray) -> None:
        """Give each of the missing tiles a slot: free ones first, then the longest unused."""
        if not len(tiles):
            return
        holder = self._holder
        kept = (holder >= 0) & (self._leases[np.maximum(holder, 0)] > 0)
        age = np.where(holder < 0, -1, self._used)
        order = np.flatnonzero(~kept)
        if len(order) > len(tiles):
            order = order[np.argpartition(age[order], len(tiles) - 1)[: len(tiles)]]
        gone = holder[order]
        gone = gone[gone >= 0]
        self.slots[gone] = -1
        self._place[gone] = -1
        holder[order] = tiles
        self._place[tiles] = order

    def _make(self, tiles: IntArray) -> None:
        """Fill the slots assigned to the tiles; release them on failure."""
        done = 0
        per_call = max(1, _NODES_AT_ONCE // self.tiling.nodes)
        try:
            while done < len(tiles):
                some = tiles[done : done + per_call]
                self._fill(some)
                done += len(some)
        finally:
            with self._change:
                lost = tiles[done:]
                self._holder[self._place[lost]] = -1
                self._place[lost] = -1
                self._change.notify_all()

    def _fill(self, tiles: IntArray) -> None:
        """Evaluate the field on the nodes of the tiles and put them into their slots."""
        nodes = self.tiling.nodes
        directions = tile_directions(self.tiling, tiles)
        values: AnyArray = np.ascontiguousarray(self._field(directions), dtype=np.float64)
        for k, tile in enumerate(tiles.tolist()):
            slot = self._place[tile]
            bounds = fill_tile(self.tiling, values[k * nodes : (k + 1) * nodes], self.pool[slot])
            self.lower[tile], self.upper[tile] = bounds
            self.slots[tile] = slot
        with self._change:
            self.made += len(tiles)
            self._change.notify_all()
