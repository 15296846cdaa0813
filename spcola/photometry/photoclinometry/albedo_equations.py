"""Normal equations of the albedo of cells [21], eliminated from those of the images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.photometry.photoclinometry.cell_pixels import NUISANCES
from spcola.photometry.photoclinometry.image_equations import Sums


@dataclass(frozen=True, eq=False)
class AlbedoEquations:
    """The albedo of cells, and the images' nuisance parameters without it.

    Attributes
    ----------
    weight : (R − 1, C − 1) ndarray
        Information on the albedo, prior included.
    step : (R − 1, C − 1) ndarray
        Change of the albedo where nothing else changes.
    by_nuisance : (P, R − 1, C − 1) ndarray
        How much the albedo falls with each of the P nuisance parameters.
    nuisance, nuisance_right : (P, P), (P,) ndarrays
        Normal matrix and right-hand side of these, without priors.
    """

    weight: FloatArray
    step: FloatArray
    by_nuisance: FloatArray
    nuisance: FloatArray
    nuisance_right: FloatArray


def eliminate_albedo(sums: Sums, albedo: FloatArray, sigma: float) -> AlbedoEquations:
    """Return the equations of albedo and nuisance parameters, slopes and heights as they are.

    Parameters
    ----------
    sums : Sums
        Over K images.
    albedo : (R − 1, C − 1) ndarray
    sigma : float
        Prior standard deviation of the albedo about 1.
    """
    count = len(sums.nuisance)
    weight = sums.normal[9] + sigma**-2
    step = (sums.right[3] + (1.0 - albedo) * sigma**-2) / weight
    products = sums.coupled.reshape(count, 4, NUISANCES, *albedo.shape)
    rows = products[:, 3].reshape(NUISANCES * count, -1)
    root = np.sqrt(weight).ravel()
    by_nuisance = rows / root
    # A matrix times its own transpose costs half of a product of two matrices.
    nuisance = -(by_nuisance @ by_nuisance.T)
    by_nuisance /= root
    right = sums.nuisance[:, :, NUISANCES].ravel() - rows @ step.ravel()
    for k in range(count):
        own = slice(NUISANCES * k, NUISANCES * (k + 1))
        nuisance[own, own] += sums.nuisance[k, :, :NUISANCES]
    by_nuisance = by_nuisance.reshape(-1, *albedo.shape)
    return AlbedoEquations(weight, step, by_nuisance, nuisance, right)


def with_priors(
    equations: tuple[FloatArray, FloatArray], before: FloatArray, known: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return matrix (P, P) and right-hand side (P,) of nuisance parameters with their priors.

    Parameters
    ----------
    equations : (P, P), (P,) ndarrays
        Without priors.
    before : (K, 5) ndarray
        Nuisance parameters of the images; the first has no prior.
    known : (K, 5, 5) ndarray
        Prior information on these about 0.
    """
    normal, right = (one.copy() for one in equations)
    for k in range(len(before)):
        own = slice(NUISANCES * k, NUISANCES * (k + 1))
        normal[own, own] += known[k]
        right[own] -= known[k] @ before[k]
    return normal, right
