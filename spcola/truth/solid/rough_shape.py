"""A coarse shape of a body as radar gives it: smoothed, off by decimetres to metres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError
from spcola.math import lattice
from spcola.shape.icq import IcqShape, icq_directions

_WAVES = 64
# Directions over which each radius is averaged, within its cell.
_SAMPLES = 25


@dataclass(frozen=True)
class RoughShapeSettings:
    """Errors of the coarse shape.

    Parameters
    ----------
    q : int
        Facets along the side of a cube's face; the radius is averaged over each.
    error : float
        Rms of its smooth errors, metres.
    wavelength : float
        Their shortest wavelength, metres; the longest is twice that.
    scale : float
        Relative error of its size.
    center : float
        Error of its centre, metres, one standard deviation of each axis.

    Raises
    ------
    SettingsError
        If a number lies outside its range.
    """

    q: int = 20
    error: float = 1.2
    wavelength: float = 80.0
    scale: float = 0.003
    center: float = 0.3

    def __post_init__(self) -> None:
        if self.q < 4 or min(self.error, self.center) < 0 or not self.wavelength > 0:
            raise SettingsError("Q, error or wavelength out of range", "rough shape")
        if not abs(self.scale) < 0.1:
            raise SettingsError("must lie within ± 0.1", "scale of the rough shape")


def rough_shape(
    radius_of: Callable[[FloatArray], FloatArray],
    settings: RoughShapeSettings,
    generator: np.random.Generator,
) -> IcqShape:
    """Return the coarse shape.

    Parameters
    ----------
    radius_of : callable
        The true radius (N,), metres, of directions (N, 3); the greatest where there are several.
    settings : RoughShapeSettings
    generator : numpy.random.Generator
    """
    directions = icq_directions(settings.q)
    flat = directions.reshape(-1, 3)
    around = flat[:, None, :] + 0.8 / settings.q * lattice(_SAMPLES)
    mean = radius_of(around.reshape(-1, 3)).reshape(len(flat), _SAMPLES).mean(axis=1)
    size = float(mean.mean())
    waves = 2.0 * np.pi * size / settings.wavelength * generator.uniform(0.5, 1.0, size=(_WAVES, 1))
    phases = generator.uniform(0.0, 2.0 * np.pi, size=_WAVES)
    bent = np.cos(flat @ (waves * lattice(_WAVES)).T + phases).sum(axis=1) * np.sqrt(2.0 / _WAVES)
    radius = (1.0 + settings.scale) * mean + settings.error * bent
    offset = settings.center * generator.normal(size=3)
    return IcqShape(
        radius.reshape(*directions.shape[:-1], 1) * directions + offset, name="rough shape"
    )
