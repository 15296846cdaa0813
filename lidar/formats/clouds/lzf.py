"""LZF, the compression of PCD files: literal runs and references to what was already written."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from spcola.compilation import compiled

_Bytes = NDArray[np.uint8]


def decompress(packed: _Bytes, size: int) -> _Bytes | None:
    """Return the `size` bytes packed in `packed`; None if there is another number of them.

    A control byte c below 32 begins a run of c + 1 literal bytes. Any other one has a length in its
    upper three bits (7: the next byte adds to it) and, with the byte after that, a distance back in
    its lower five; length + 2 bytes are copied from there.
    """
    unpacked = np.empty(size, dtype=np.uint8)
    return unpacked if _decompress(packed, unpacked) == size else None


@compiled
def _decompress(packed: _Bytes, unpacked: _Bytes) -> int:
    """Fill `unpacked`; return how many bytes were written, −1 if the data are broken."""
    at = done = 0
    while at < len(packed):
        control = int(packed[at])
        at += 1
        if control < 32:
            count = control + 1
            if at + count > len(packed) or done + count > len(unpacked):
                return -1
            unpacked[done : done + count] = packed[at : at + count]
            at += count
            done += count
            continue
        count = control >> 5
        if at + (2 if count == 7 else 1) > len(packed):
            return -1
        if count == 7:
            count += int(packed[at])
            at += 1
        count += 2
        source = done - ((control & 31) << 8) - int(packed[at]) - 1
        at += 1
        if source < 0 or done + count > len(unpacked):
            return -1
        # Byte by byte: a copy may overlap what it writes, which repeats a pattern.
        for _ in range(count):
            unpacked[done] = unpacked[source]
            done += 1
            source += 1
    return done
