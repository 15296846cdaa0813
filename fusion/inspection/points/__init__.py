"""Files of any kind as points of a surface, and such files moved."""

from fusion.inspection.points.moved import check_target, write_moved
from fusion.inspection.points.sources import PointSource, read_points

__all__ = ["PointSource", "check_target", "read_points", "write_moved"]
