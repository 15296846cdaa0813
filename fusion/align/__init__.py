"""Two clouds of points or surfaces of one ground, aligned: ``spcola align``."""

from fusion.align.align import Alignment, AlignOptions, align_clouds
from fusion.align.moved import check_target, write_moved
from fusion.align.surface import PointSource, read_points

__all__ = [
    "AlignOptions",
    "Alignment",
    "PointSource",
    "align_clouds",
    "check_target",
    "read_points",
    "write_moved",
]
