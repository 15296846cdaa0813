"""Mapolas: lidar returns gridded in the maplet format."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spcola.arrays import (
    AnyArray,
    FloatArray,
    frozen,
    read_only,
)
from spcola.errors import InvalidValueError
from spcola.grids import Maplet, check_layer


@dataclass(frozen=True, eq=False)
class Mapola(Maplet):
    """A :class:`~spcola.grids.Maplet` made of lidar returns; its albedo is 1.

    Parameters
    ----------
    count : (2q+1, 2q+1) integer ndarray
        Returns in each cell.
    spread : (2q+1, 2q+1) array_like
        Robust standard deviation (1.4826 × median absolute deviation) of the slope-corrected
        heights in the cell, metres; NaN where fewer than three returns fell.
    scan_share : mapping of str to float
        Share of the mapola's returns that came from each scan: what makes the errors of two
        mapolas alike.

    Raises
    ------
    InvalidValueError
        If a layer has another shape, or a cell with a height has no return.
    """

    count: AnyArray = None  # type: ignore[assignment]  # refused if missing
    spread: FloatArray = None  # type: ignore[assignment]  # filled in __post_init__
    scan_share: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.count is None:
            raise InvalidValueError("a mapola needs the count of returns", self.name)
        count = np.array(self.count, dtype=np.int32)
        check_layer(count, self.grid, f"{self.name}.count")
        if (count[self.valid] < 1).any():
            raise InvalidValueError("has a height where no return fell", self.name)
        object.__setattr__(self, "count", read_only(count))
        spread = np.full(self.grid.shape, np.nan) if self.spread is None else self.spread
        object.__setattr__(self, "spread", frozen(spread, self.grid.shape, f"{self.name}.spread"))

    @property
    def coverage(self) -> float:
        """Share of the cells that hold a height, 0 … 1."""
        return float(np.mean(self.valid))
