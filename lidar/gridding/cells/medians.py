"""Medians of a few values inside kernels, and of many cells at once."""

from __future__ import annotations

from functools import cache

import numpy as np

from spcola.arrays import FloatArray, IntArray, read_only
from spcola.compilation import compiled, compiled_inline

# Runs of up to so many values are sorted by networks, of all even lengths up to the first number,
# then in steps; longer ones are handled by counting, one at a time.
_EVERY, _STEP, _LONGEST = 64, 8, 128
# Runs are grouped by length among so many neighbours.
_NEAR = 16384
# Runs that are sorted in parallel: with the usual tens of values they fit the nearest cache.
_LANES = 64


@compiled
def median_of(values: FloatArray, size: int) -> float:
    """Median of the first `size` (≥ 1) values, none of them NaN.

    The upper middle is the largest value with at most half of the values below it. Candidates are
    tested by counting, each between the bounds set by the earlier ones: counting has no branches
    and is vectorised, which is twice as fast as moving values.
    """
    middle = size // 2
    low, high, least = -np.inf, np.inf, 0
    whole = 1
    while whole < size:
        whole *= 2
    i = 0
    for _ in range(whole):
        # In the order of van der Corput's sequence: sorted values are bisected.
        bit = whole >> 1
        while i & bit:
            i ^= bit
            bit >>= 1
        i |= bit
        if i >= size or values[i] <= low or values[i] >= high:
            continue
        below = 0
        for j in range(size):
            below += values[j] < values[i]
        if below > middle:
            high = values[i]
        else:
            low, least = values[i], below
            if below == middle:
                break
    if size % 2 == 1 or least < middle:
        return low
    lower = -np.inf
    for j in range(size):
        lower = max(lower, values[j] if values[j] < low else -np.inf)
    return 0.5 * (lower + low)


@cache
def middle_network(size: int) -> IntArray:
    """Return exchanges (E, 2) that bring the two middle ones of `size` (even) values there.

    Batcher's merge exchange sort (Knuth, The Art of Computer Programming 3, algorithm 5.2.2 M)
    without the exchanges that the middle does not depend on.
    """
    pairs = []
    merged = 1
    while merged < size:
        step = merged
        while step >= 1:
            for first in range(step % merged, size - step, 2 * step):
                for low in range(first, min(first + step, size - step)):
                    if low // (2 * merged) == (low + step) // (2 * merged):
                        pairs.append((low, low + step))
            step //= 2
        merged *= 2
    needed, kept = {size // 2 - 1, size // 2}, []
    for pair in reversed(pairs):
        if not needed.isdisjoint(pair):
            needed.update(pair)
            kept.append(pair)
    return read_only(np.array(kept[::-1], dtype=np.int64).reshape(-1, 2))


@compiled
def column_medians(values: FloatArray, network: IntArray, out: FloatArray) -> None:
    """Medians of the columns of `values` (N, C), N even, whose values are reordered.

    `network` is that of :func:`middle_network` for N. Exchanges have no branches, and are
    vectorised over columns: the median of a column with NaN is meaningless.
    """
    for e in range(len(network)):
        _exchange(values[network[e, 0]], values[network[e, 1]])
    middle = len(values) // 2
    lower, upper = values[middle - 1], values[middle]
    for j in range(len(out)):
        out[j] = 0.5 * (lower[j] + upper[j])


@compiled_inline
def _exchange(low: FloatArray, high: FloatArray) -> None:
    for j in range(len(low)):
        a, b = low[j], high[j]
        low[j] = a if a < b else b
        high[j] = b if a < b else a


def run_medians(
    start: IntArray,
    values: FloatArray,
    runs: IntArray,
    out: FloatArray,
    *,
    center: FloatArray | None = None,
) -> None:
    """Write the medians of some runs of values to `out`; NaN for those without any.

    Runs of similar length are sorted in parallel by a network of exchanges: there are no branches,
    and each exchange is vectorised over several runs.

    Parameters
    ----------
    start : (C + 1,) ndarray of int
        The values of run c are ``values[start[c]:start[c + 1]]``.
    values : (K,) ndarray
        Without NaN.
    runs : (M,) ndarray of int
        The requested runs.
    out : (C,) ndarray
        Unchanged for other runs.
    center : (C,) ndarray, optional
        Medians are of the distances from this center of each run.
    """
    for first in range(0, len(runs), _NEAR):
        _run_medians(start, values, runs[first : first + _NEAR], center, _networks(), out)


@cache
def _networks() -> tuple[IntArray, IntArray, IntArray]:
    """Exchanges (E, 2) of all lengths one after another, the start of each, and the lengths."""
    lengths = [*range(2, _EVERY + 1, 2), *range(_EVERY + _STEP, _LONGEST + 1, _STEP)]
    networks = [middle_network(length) for length in lengths]
    begin = np.cumsum([0, *(len(network) for network in networks)])
    return read_only(np.concatenate(networks)), read_only(begin), read_only(np.array(lengths))


@compiled_inline
def _network_of(size: int) -> int:
    """Number of the network for a run of 1 … `_LONGEST` values."""
    if size <= _EVERY:
        return (size + 1) // 2 - 1
    return _EVERY // 2 + (size - _EVERY + _STEP - 1) // _STEP - 1


@compiled
def _run_medians(
    start: IntArray,
    values: FloatArray,
    runs: IntArray,
    center: FloatArray | None,
    networks: tuple[IntArray, IntArray, IntArray],
    out: FloatArray,
) -> None:
    exchanges, begin, lengths = networks
    ordered, first = _by_length(start, runs, len(lengths))
    block = np.zeros((_LONGEST, _LANES))
    for which in range(len(lengths)):
        length = lengths[which]
        lower, upper = block[length // 2 - 1], block[length // 2]
        for done in range(first[which], first[which + 1], _LANES):
            some = ordered[done : min(done + _LANES, first[which + 1])]
            for j in range(len(some)):
                _put_column(start, values, some[j], center, length, block, j)
            for e in range(begin[which], begin[which + 1]):
                _exchange(block[exchanges[e, 0]], block[exchanges[e, 1]])
            for j in range(len(some)):
                odd = (start[some[j] + 1] - start[some[j]]) % 2
                out[some[j]] = lower[j] if odd else 0.5 * (lower[j] + upper[j])
    _median_of_others(start, values, ordered[first[-1] :], center, out)


@compiled
def _by_length(start: IntArray, runs: IntArray, lengths: int) -> tuple[IntArray, IntArray]:
    """Runs ordered by network, and the start of each group; then empty and long runs."""
    first = np.zeros(lengths + 2, dtype=np.int64)
    which = np.empty(len(runs), dtype=np.int64)
    for n in range(len(runs)):
        size = start[runs[n] + 1] - start[runs[n]]
        which[n] = _network_of(size) if 0 < size <= _LONGEST else lengths
        first[which[n] + 1] += 1
    for k in range(lengths + 1):
        first[k + 1] += first[k]
    free = first.copy()
    ordered = np.empty(len(runs), dtype=np.int64)
    for n in range(len(runs)):
        ordered[free[which[n]]] = runs[n]
        free[which[n]] += 1
    return ordered, first[:-1]


@compiled_inline
def _put_column(
    start: IntArray,
    values: FloatArray,
    run: int,
    center: FloatArray | None,
    length: int,
    block: FloatArray,
    j: int,
) -> None:
    """Write a run into column j, padded by infinities so that its middle remains in the middle.

    For an odd number of values the middle one is just below the middle of the column.
    """
    size = start[run + 1] - start[run]
    low = (length - size) // 2
    for i in range(low):
        block[i, j] = -np.inf
    for i in range(size):
        value = values[start[run] + i]
        block[low + i, j] = value if center is None else abs(value - center[run])
    for i in range(low + size, length):
        block[i, j] = np.inf


@compiled
def _median_of_others(
    start: IntArray, values: FloatArray, runs: IntArray, center: FloatArray | None, out: FloatArray
) -> None:
    """Write the medians of empty runs and of those too long for a network."""
    longest = 0
    for run in runs:
        longest = max(longest, start[run + 1] - start[run])
    buffer = np.empty(longest)
    for run in runs:
        size = start[run + 1] - start[run]
        for i in range(size):
            value = values[start[run] + i]
            buffer[i] = value if center is None else abs(value - center[run])
        out[run] = median_of(buffer, size) if size > 0 else np.nan
