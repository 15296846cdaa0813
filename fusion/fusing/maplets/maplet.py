"""Fused maplets: heights that images and lidar determine together."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from spcola.arrays import AnyArray, check_shape, read_only
from spcola.errors import InvalidValueError
from spcola.grids import Maplet


class Source(IntEnum):
    """Source of a fused height; the numbers are those in the products."""

    NONE = 0
    """No height."""
    IMAGE = 1
    """Image slopes (or the SPC maplet) alone."""
    LIDAR = 2
    """Lidar returns alone: the image slope is undefined there (shadow, never imaged)."""
    BOTH = 3
    """Image slopes and lidar returns."""
    FILLED = 4
    """Neither: interpolated from the neighbours by the integration."""


@dataclass(frozen=True, eq=False)
class FusedMaplet(Maplet):
    """A :class:`~spcola.grids.Maplet` with the source of each height.

    Parameters
    ----------
    count : (2q+1, 2q+1) integer ndarray
        Lidar returns that fell in each cell.
    source : (2q+1, 2q+1) integer ndarray
        One :class:`Source` for each point.

    Raises
    ------
    InvalidValueError
        If a layer is missing or has another shape, a count is negative, a source is not one of
        :class:`Source`, or a point has a height without a source or a source without a height.
    """

    count: AnyArray = None  # type: ignore[assignment]  # refused if missing
    source: AnyArray = None  # type: ignore[assignment]  # refused if missing

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.count is None or self.source is None:
            raise InvalidValueError("a fused maplet needs its count and source layers", self.name)
        check_shape(np.asarray(self.count), self.grid.shape, f"{self.name}.count")
        check_shape(np.asarray(self.source), self.grid.shape, f"{self.name}.source")
        count = np.array(self.count, dtype=np.int32)
        if (count < 0).any():
            raise InvalidValueError("holds a negative count", self.name)
        if not np.isin(self.source, [int(source) for source in Source]).all():
            raise InvalidValueError("holds a source that is not 0 … 4", self.name)
        source = np.array(self.source, dtype=np.uint8)
        if ((source != Source.NONE) != self.valid).any():
            raise InvalidValueError(
                "a point must have both a height and a source, or neither", self.name
            )
        object.__setattr__(self, "count", read_only(count))
        object.__setattr__(self, "source", read_only(source))

    def share(self, source: Source) -> float:
        """Share of all grid points whose height has this `source`, 0 … 1."""
        return float(np.mean(self.source == source))
