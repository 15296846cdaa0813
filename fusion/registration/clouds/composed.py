"""A registration of clouds that were moved before, as one of the clouds as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fusion.registration.direct import DirectRegistration
from fusion.registration.transform import about_origin
from spcola.arrays import FloatArray
from spcola.math import Affine


def composed(
    found: DirectRegistration, before: Affine, after: FloatArray | None = None
) -> DirectRegistration:
    """Return the registration of a cloud that `before` was applied to.

    With ``T = shift ∘ found ∘ before``, small rotations act on the left and stay; a change of the
    found scale counts times that of `before`, and one of the found matrix δA as ``δA · before``.
    The translation's covariance is carried from the point that `before` takes to the origin.

    Parameters
    ----------
    found : DirectRegistration
        Of the moved cloud.
    before : Affine
        What the moving cloud was moved by; a similarity unless the model is affine.
    after : (3,) ndarray, optional
        Added to what is found, metres.
    """
    shift = np.zeros(3) if after is None else after
    matrix = found.transform.matrix @ before.matrix
    translation = found.transform.matrix @ before.translation + found.transform.translation + shift
    transform = Affine(matrix, translation, found.transform.target, found.transform.source)
    carried = np.eye(len(found.parameters))
    if found.model == "affine":
        carried[3:, 3:] = np.kron(np.eye(3), before.matrix.T)
    elif found.model == "similarity":
        carried[6, 6] = before.nearest_similarity().scale
    back = before.inverse()
    covariance = found.covariance
    if np.isfinite(covariance).all():
        covariance = about_origin(
            carried @ covariance @ carried.T, found.model, transform, back.translation
        )
    return replace(
        found, transform=transform, covariance=covariance, center=back.apply(found.center)
    )
