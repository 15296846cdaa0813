"""Whether observations leave a combination of parameters free."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import NotObservableError

# Smallest share of the largest eigenvalue of the scaled normal matrix that is still information
# and not rounding.
_RANK_TOLERANCE = 1e-11


def check_rank(information: FloatArray, names: tuple[str, ...]) -> None:
    """Refuse a scaled information matrix (P, P) that leaves some direction free.

    Raises
    ------
    NotObservableError
        Naming the parameters that take part in the free directions.
    """
    values, vectors = np.linalg.eigh(information)
    free = values <= _RANK_TOLERANCE * max(float(values[-1]), 0.0)
    if not free.any():
        return
    taking_part = np.max(np.abs(vectors[:, free]), axis=1) > 0.1
    involved = tuple(name for name, part in zip(names, taking_part, strict=True) if part)
    raise NotObservableError(
        f"the observations leave {', '.join(involved)} free",
        involved,
        do="add observations from other parts of the body, or estimate fewer parameters",
    )
