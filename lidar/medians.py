"""The median of a few values, as kernels ask for it cell by cell."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.kernel import kernel


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
