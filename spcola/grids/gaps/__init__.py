"""Gaps of a grid: closed, filled, bridged."""

from spcola.grids.gaps.gaps import (
    bridged,
    bridged_mask,
    carried_on,
    closable,
    closed,
    filled,
    plane_of,
    trend_of,
)

__all__ = [
    "bridged",
    "bridged_mask",
    "carried_on",
    "closable",
    "closed",
    "filled",
    "plane_of",
    "trend_of",
]
