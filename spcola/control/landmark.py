"""Landmarks: the centres of maplets as control points, with their images and overlaps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spcola.arrays import FloatArray, check_finite, frozen
from spcola.camera import ImagePoint
from spcola.grids import MapletGrid


@dataclass(frozen=True)
class MapOverlap:
    """An overlapping maplet: its name and the three numbers that SPC stores for the overlap.

    The numbers are the neighbour's centre in this maplet's frame (x, y in grid steps along Ux
    and Uy, h along Uz), in units of this maplet's GSD.
    """

    name: str
    x: float
    y: float
    h: float


@dataclass(frozen=True, eq=False)
class Landmark:
    """A control point on the surface.

    Parameters
    ----------
    name : str
        At most 6 characters in SPC.
    grid : MapletGrid
        Frame of its maplet: V (metres), axes, GSD, half-size.
    sigma : (3,) array_like
        One standard deviation of V along the body-fixed axes, metres (SIGMA_LMK).
    prior_sigma : float
        SIGKM of the file, metres: the a-priori uncertainty of V.
    rms : float
        RMSLMK: root mean square of the brightness or pixel residuals, as stored by SPC.
    status : str
        The flag after the name ("T" or "F").
    horizon : tuple of 4 int
        The HORIZON line, unchanged.
    pictures, limbs : tuple of ImagePoint
        Images (by name) in which the landmark is seen; limb observations.
    overlaps : tuple of MapOverlap
        Overlapping maplets.
    """

    name: str
    grid: MapletGrid
    sigma: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    prior_sigma: float = float("nan")
    rms: float = float("nan")
    status: str = "T"
    horizon: tuple[int, int, int, int] = (-1, -1, -1, -1)
    pictures: tuple[ImagePoint, ...] = ()
    overlaps: tuple[MapOverlap, ...] = ()
    limbs: tuple[ImagePoint, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "sigma", frozen(self.sigma, (3,), f"{self.name}.sigma"))
        check_finite(self.grid.center, f"{self.name}.V")
