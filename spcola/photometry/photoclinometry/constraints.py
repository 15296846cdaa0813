"""Heights that constrain the integration of slopes inside photoclinometry [23]."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray, check_shape, frozen
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid


@dataclass(frozen=True, eq=False)
class HeightConstraint:
    """Heights of points of a grid.

    Parameters
    ----------
    name : str
        Where they come from: the shape, overlapping maplets, another instrument.
    height : (R, C) ndarray
        Metres along Uz; NaN where there is none.
    weight : (R, C) ndarray
        1/σ², 1/m²; of heights with common errors, σ² times the number of points that share one.

    Raises
    ------
    InvalidValueError
        If shapes differ, or a weight is negative or not finite.
    """

    name: str
    height: FloatArray
    weight: FloatArray

    def __post_init__(self) -> None:
        height = frozen(self.height, (None, None), f"heights of {self.name}")
        weight = frozen(self.weight, (None, None), f"weights of {self.name}")
        check_shape(weight, height.shape, f"weights of {self.name}")
        if np.isinf(height).any() or not ((weight >= 0) & (weight < np.inf)).all():
            raise InvalidValueError("contains an infinite height or a wrong weight", self.name)
        object.__setattr__(self, "height", height)
        object.__setattr__(self, "weight", weight)

    @classmethod
    def of_sigma(
        cls, name: str, height: FloatArray, sigma: FloatArray | float, *, common: float = 1.0
    ) -> HeightConstraint:
        """Return heights of a sigma, metres, of which `common` neighbouring points share one error.

        Parameters
        ----------
        name : str
        height : (R, C) ndarray
            Metres; NaN where unknown.
        sigma : float or (R, C) ndarray
            Metres; NaN where unknown.
        common : float
        """
        with np.errstate(divide="ignore"):
            weight = 1.0 / (np.broadcast_to(sigma, height.shape) ** 2 * common)
        known = np.isfinite(height) & np.isfinite(weight)
        return cls(name, np.where(known, height, np.nan), np.where(known, weight, 0.0))


def gathered(
    constraints: tuple[HeightConstraint, ...], grid: MapletGrid, level: MapletGrid
) -> tuple[FloatArray, FloatArray]:
    """Return weighted mean heights (R', C') and the sums of weights at the points of a level.

    Each point of `grid` counts at the nearest point of the coarser `level`. Where there is no
    height, the mean is 0, with weight 0.
    """
    index = np.rint(grid.offsets * grid.gsd / level.gsd).astype(np.int64) + level.half_size
    place = (index[:, None] * level.size + index[None, :]).ravel()
    weight, pull = np.zeros((2, level.size**2))
    for one in constraints:
        check_shape(one.height, grid.shape, f"heights of {one.name}")
        weight += np.bincount(place, one.weight.ravel(), level.size**2)
        pull += np.bincount(place, (one.weight * np.nan_to_num(one.height)).ravel(), level.size**2)
    mean = np.divide(pull, weight, out=np.zeros_like(pull), where=weight > 0)
    return mean.reshape(level.shape), weight.reshape(level.shape)
