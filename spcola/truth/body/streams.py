"""Seeded random streams: one for each purpose, equal on every machine."""

from __future__ import annotations

import numpy as np


def stream(seed: int, purpose: str) -> np.random.Generator:
    """Return the generator of `seed` that belongs to `purpose`.

    Streams of different purposes are independent, so that more draws from one (another crater,
    another scan) leave everything else unchanged. Philox is counter-based integer arithmetic: its
    numbers do not depend on the machine.
    """
    words = np.random.SeedSequence([seed, *purpose.encode("utf-8")])
    return np.random.Generator(np.random.Philox(words))
