"""Test whether observations determine all combinations of parameters."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import NotObservableError

# Eigenvalues of the scaled normal matrix below this share of the largest are rounding errors.
_RANK_TOLERANCE = 1e-11


def check_rank(information: FloatArray, names: tuple[str, ...]) -> None:
    """Refuse a scaled normal matrix (P, P) that does not determine some direction.

    Parameters
    ----------
    information : (P, P) ndarray
        Normal matrix, scaled to a unit diagonal.
    names : tuple of str
        Of the P parameters.

    Raises
    ------
    NotObservableError
        With the names of the parameters that are part of the undetermined directions.
    """
    values, vectors = np.linalg.eigh(information)
    free = values <= _RANK_TOLERANCE * max(float(values[-1]), 0.0)
    if not free.any():
        return
    taking_part = np.max(np.abs(vectors[:, free]), axis=1) > 0.1
    involved = tuple(name for name, part in zip(names, taking_part, strict=True) if part)
    raise NotObservableError(
        f"the observations do not determine {', '.join(involved)}",
        involved,
        do="add observations from other parts of the body, or estimate fewer parameters",
    )
