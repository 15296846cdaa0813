"""Mapolas and bigmaps of lidar: returns gridded in the maplet format."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spcola.arrays import AnyArray, BoolArray, FloatArray, check_shape, frozen, read_only
from spcola.errors import InvalidValueError
from spcola.grids import Maplet


@dataclass(frozen=True, eq=False)
class GriddedReturns(Maplet):
    """A :class:`~spcola.grids.Maplet` made of lidar returns; its albedo is 1.

    Parameters
    ----------
    count : (2q+1, 2q+1) integer ndarray
        Returns in each cell; 0 throughout by default.
    spread : (2q+1, 2q+1) array_like
        Robust standard deviation (1.4826 × median absolute deviation) of the slope-corrected
        heights in the cell, metres; NaN where fewer than three returns fell.
    scan_share : mapping of str to float
        Share of the returns from each scan: it determines how far the errors of two grids are
        correlated.

    Raises
    ------
    InvalidValueError
        If a layer has another shape.
    """

    count: AnyArray = None  # type: ignore[assignment]  # filled in __post_init__
    spread: FloatArray = None  # type: ignore[assignment]  # filled in __post_init__
    scan_share: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        count = np.zeros(self.grid.shape) if self.count is None else self.count
        count = np.array(count, dtype=np.int32)
        check_shape(count, self.grid.shape, f"{self.name}.count")
        object.__setattr__(self, "count", read_only(count))
        spread = np.full(self.grid.shape, np.nan) if self.spread is None else self.spread
        object.__setattr__(self, "spread", frozen(spread, self.grid.shape, f"{self.name}.spread"))


@dataclass(frozen=True, eq=False)
class Mapola(GriddedReturns):
    """Gridded returns with heights only in cells with returns.

    Raises
    ------
    InvalidValueError
        If `count` is not given, or a cell with a height has no return.
    """

    def __post_init__(self) -> None:
        if self.count is None:
            raise InvalidValueError("a mapola needs the count of returns", self.name)
        super().__post_init__()
        if (self.count[self.valid] < 1).any():
            raise InvalidValueError("has a height where no return fell", self.name)

    @property
    def coverage(self) -> float:
        """Share of the cells that have a height, 0 … 1."""
        return float(np.mean(self.valid))


@dataclass(frozen=True, eq=False)
class LidarBigmap(GriddedReturns):
    """Gridded returns with heights also in cells without returns, where `count` is 0."""

    @property
    def bridged(self) -> BoolArray:
        """Mask of heights in cells without returns."""
        mask: BoolArray = self.valid & (self.count == 0)
        return mask
