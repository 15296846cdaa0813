"""The median of a few values, as kernels ask for it cell by cell."""

from __future__ import annotations

from functools import cache

import numpy as np

from spcola.arrays import FloatArray, IntArray, read_only
from spcola.kernel import inlined_kernel, kernel


@kernel
def median_of(values: FloatArray, size: int) -> float:
    """Median of the first `size` (≥ 1) values, none of them NaN.

    The upper middle is the largest value that has no more than half of them below it. Candidates
    are tried by counting, each between the bounds that the ones before it leave: a count has no
    branches and takes several values at once, which is twice as fast as moving them about.
    """
    middle = size // 2
    low, high, least = -np.inf, np.inf, 0
    whole = 1
    while whole < size:
        whole *= 2
    i = 0
    for _ in range(whole):
        # In the order of van der Corput's sequence: values that come sorted are bisected.
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


@kernel
def column_medians(values: FloatArray, network: IntArray, out: FloatArray) -> None:
    """Medians of the columns of `values` (N, C), N even, which are put in another order.

    `network` is that of :func:`middle_network` for N. Exchanges have no branches, and take
    several columns at once: with NaN among its values a column's median means nothing.
    """
    for e in range(len(network)):
        _exchange(values[network[e, 0]], values[network[e, 1]])
    middle = len(values) // 2
    lower, upper = values[middle - 1], values[middle]
    for j in range(len(out)):
        out[j] = 0.5 * (lower[j] + upper[j])


@inlined_kernel
def _exchange(low: FloatArray, high: FloatArray) -> None:
    for j in range(len(low)):
        a, b = low[j], high[j]
        low[j] = a if a < b else b
        high[j] = b if a < b else a
