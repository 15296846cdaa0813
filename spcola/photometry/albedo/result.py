"""What is found of an albedo on fixed topography."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from spcola.arrays import FloatArray
from spcola.grids import Maplet
from spcola.photometry.photoclinometry import ImageFit


class AlbedoOutcome(StrEnum):
    """How the solution of an albedo ended."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not-converged"
    """It still changed in the last round."""
    NO_IMAGE = "no-image"
    """No image shows enough lit ground: nothing is known of the albedo."""


@dataclass(frozen=True, eq=False)
class AlbedoSolution:
    """Relative albedo of a grid.

    Attributes
    ----------
    albedo, sigma : (R, C) ndarrays
        Of points, in the convention that was asked for; NaN where images determine it less than
        the prior does, such as in shadow, and where the height is unknown. Sigmas are those of a
        cell: a point has the mean of four, with errors up to half as large.
    mean : float
        Of that convention: the albedo that stands for an unknown one.
    images : tuple of ImageFit
        Of all images, at the end.
    residual_start, residual : float
        Median over images of the relative residual of brightness, with an even albedo and at the
        end; NaN without images.
    changes, residuals : tuple of float
        Of each round: root mean square of the changes of the albedo, relative to its mean, and
        residual before it.
    outcome : AlbedoOutcome
    """

    albedo: FloatArray
    sigma: FloatArray
    mean: float
    images: tuple[ImageFit, ...]
    residual_start: float
    residual: float
    changes: tuple[float, ...]
    residuals: tuple[float, ...]
    outcome: AlbedoOutcome

    @property
    def share(self) -> float:
        """Share of the points whose albedo images determine, 0 … 1."""
        return float(np.mean(np.isfinite(self.albedo)))

    def on(self, ground: Maplet) -> Maplet:
        """Return the ground with this albedo, and the mean where it is unknown.

        A .MAP has no mark for a known height of unknown albedo.
        """
        return replace(ground, albedo=np.where(np.isfinite(self.albedo), self.albedo, self.mean))
