"""Points sorted into the cells of a grid by counting, in a unique order.

Within a cell points keep their original order. A few points are sorted directly. Many are first
distributed to blocks of cells, then sorted within each block: each block fits the cache, and blocks
are sorted on several cores. The result is the same to the bit.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline, usable_threads

Frame = tuple[FloatArray, FloatArray]
"""Centre (3,) of a grid, metres, and its axes (3, 3): Ux and Uy over the GSD, Uz."""
Sorted = tuple[IntArray, IntArray, FloatArray]
"""Starts of the cells (C + 1,), the sorted points' numbers, and their places (3, K).

Place in the cell along Ux and Uy in grid steps [24], height along Uz in metres.
"""

# Number of points above which threads, and the detour by blocks, are worthwhile.
MANY = 1_000_000
# Cells of a block: their points, some tens each, fit into the cache of a core.
_BLOCK = 2048


def sort_points(points: FloatArray, frame: Frame, half_size: int, reach: float) -> Sorted:
    """Sort points (N, 3), metres, by cells; drop those outside the grid or beyond `reach`."""
    cells = (2 * half_size + 1) ** 2
    if len(points) < MANY or cells <= _BLOCK:
        return _sorted(points, frame, half_size, reach)
    blocks = -(-cells // _BLOCK)
    threads = usable_threads()
    ends = np.linspace(0, len(points), threads + 1).astype(np.int64)
    chunks = list(pairwise(ends.tolist()))
    with ThreadPoolExecutor(threads) as pool:

        def counted(chunk: tuple[int, int]) -> IntArray:
            return _count_blocks(points, chunk, frame, half_size, reach, blocks)

        counts = np.array(list(pool.map(counted, chunks)))
        # In each block first the points of the first chunk, and so on.
        before = np.cumsum(counts, axis=0) - counts
        begin = np.concatenate([[0], np.cumsum(counts.sum(axis=0))])
        index, local = np.empty(begin[-1], dtype=np.int32), np.empty((3, begin[-1]))

        def distributed(number: int) -> None:
            free = begin[:-1] + before[number]
            _distribute(points, chunks[number], frame, half_size, reach, free, index, local)

        list(pool.map(distributed, range(threads)))
        start = np.zeros(cells + 1, dtype=np.int64)

        def sorted_block(block: int) -> None:
            _sort_block(begin, block, half_size, start, index, local)

        list(pool.map(sorted_block, range(blocks)))
    return start, index, local


@compiled_inline
def _placed(
    points: FloatArray, i: int, frame: Frame, half_size: int, reach: float
) -> tuple[int, float, float, float]:
    """Cell of a point, −1 outside the grid, and its place: grid steps, and metres along Uz."""
    center, axes = frame
    x, y, z = points[i, 0] - center[0], points[i, 1] - center[1], points[i, 2] - center[2]
    along_x = x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2]
    along_y = x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2]
    height = x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2]
    column, row = np.floor(along_x + 0.5), np.floor(along_y + 0.5)
    cell = -1
    if abs(column) <= half_size and abs(row) <= half_size and abs(height) <= reach:
        cell = int(row + half_size) * (2 * half_size + 1) + int(column + half_size)
    return cell, along_x, along_y, height


@compiled
def _sorted(points: FloatArray, frame: Frame, half_size: int, reach: float) -> Sorted:
    size = 2 * half_size + 1
    cell = np.empty(len(points), dtype=np.int32)
    start = np.zeros(size * size + 1, dtype=np.int64)
    for i in range(len(points)):
        cell[i], _, _, _ = _placed(points, i, frame, half_size, reach)
        if cell[i] >= 0:
            start[cell[i] + 1] += 1
    for c in range(size * size):
        start[c + 1] += start[c]
    free = start[:-1].copy()
    index = np.empty(start[-1], dtype=np.int32)
    local = np.empty((3, start[-1]))
    for i in range(len(points)):
        if cell[i] >= 0:
            k = free[cell[i]]
            free[cell[i]] += 1
            index[k] = i
            # Computed again: storing it takes more memory, and time, than this.
            _, along_x, along_y, height = _placed(points, i, frame, half_size, reach)
            local[0, k] = along_x - np.floor(along_x + 0.5)
            local[1, k] = along_y - np.floor(along_y + 0.5)
            local[2, k] = height
    return start, index, local


@compiled
def _count_blocks(
    points: FloatArray,
    chunk: tuple[int, int],
    frame: Frame,
    half_size: int,
    reach: float,
    blocks: int,
) -> IntArray:
    """How many points of a chunk fall into each block."""
    count = np.zeros(blocks, dtype=np.int64)
    for i in range(chunk[0], chunk[1]):
        cell, _, _, _ = _placed(points, i, frame, half_size, reach)
        if cell >= 0:
            count[cell // _BLOCK] += 1
    return count


@compiled
def _distribute(
    points: FloatArray,
    chunk: tuple[int, int],
    frame: Frame,
    half_size: int,
    reach: float,
    free: IntArray,
    index: IntArray,
    local: FloatArray,
) -> None:
    """Write the points of a chunk to their blocks: number, steps along Ux and Uy, height."""
    for i in range(chunk[0], chunk[1]):
        cell, along_x, along_y, height = _placed(points, i, frame, half_size, reach)
        if cell >= 0:
            k = free[cell // _BLOCK]
            free[cell // _BLOCK] += 1
            index[k] = i
            local[0, k], local[1, k], local[2, k] = along_x, along_y, height


@compiled
def _sort_block(
    begin: IntArray,
    block: int,
    half_size: int,
    start: IntArray,
    index: IntArray,
    local: FloatArray,
) -> None:
    """Sort the points of a block by cells, and store the starts of its cells."""
    side = 2 * half_size + 1
    first, own = begin[block], block * _BLOCK
    size, cells = begin[block + 1] - first, min(_BLOCK, side * side - own)
    to = np.empty(size, dtype=np.int32)
    free = np.zeros(cells, dtype=np.int32)
    for k in range(size):
        column = np.floor(local[0, first + k] + 0.5)
        row = np.floor(local[1, first + k] + 0.5)
        local[0, first + k] -= column
        local[1, first + k] -= row
        to[k] = int(row + half_size) * side + int(column + half_size) - own
        free[to[k]] += 1
    at = 0
    for c in range(cells):
        free[c], at = at, at + free[c]
        start[own + c + 1] = first + at
    for k in range(size):
        c = to[k]
        to[k] = free[c]
        free[c] += 1
    numbers = index[first : first + size].copy()
    for k in range(size):
        index[first + to[k]] = numbers[k]
    for axis in range(3):
        values = local[axis, first : first + size].copy()
        for k in range(size):
            local[axis, first + to[k]] = values[k]
