"""What errors of the photometric function do to a surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spcola.arrays import FloatArray
from spcola.photometry.functions import PhotometricFunction
from spcola.photometry.photoclinometry.surface import Surface, cell_slopes
from spcola.photometry.photoclinometry.surface_fit import SurfaceFit

# Rounds with another function from the solved surface on. After six heights have changed by 0.8 of
# what they change by in ten, or in a solution with it from the start.
_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class FunctionErrors:
    """Variances of a surface by errors of the photometric function.

    Parameters
    ----------
    heights : (R, C) ndarray
        Square metres.
    slopes : (2, R − 1, C − 1) ndarray
        Of ∂h/∂x and ∂h/∂y of cells.
    albedo : (R − 1, C − 1) ndarray
        Of the relative albedo of cells.
    """

    heights: FloatArray
    slopes: FloatArray
    albedo: FloatArray

    @classmethod
    def of(cls, fit: SurfaceFit) -> FunctionErrors:
        """Return the sum of squares of what the other functions of the options change.

        Each is used for some rounds from the surface on, and so is the one in use, whose own
        changes are no errors.

        Parameters
        ----------
        fit : SurfaceFit
            After its last round.
        """
        cells = fit.surface.albedo.shape
        found = cls(np.zeros(fit.surface.height.shape), np.zeros((2, *cells)), np.zeros(cells))
        if not fit.options.other_functions:
            return found
        own = _after_rounds(fit, fit.options.function)
        for function, weight in fit.options.other_functions:
            other = _after_rounds(fit, function)
            rise = other.height - own.height
            found.heights[:] += weight * rise**2
            found.slopes[:] += weight * cell_slopes(rise, own.gsd) ** 2
            found.albedo[:] += weight * (other.albedo - own.albedo) ** 2
        return found


def _after_rounds(fit: SurfaceFit, function: PhotometricFunction) -> Surface:
    """Return the surface after further rounds with a function; the fit stays as it is."""
    options = replace(fit.options, function=function)
    further = replace(fit, options=options, states=list(fit.states), rounds=list(fit.rounds))
    for _ in range(_ROUNDS):
        further.round()
    return further.surface
