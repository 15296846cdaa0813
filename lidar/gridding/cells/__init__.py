"""Returns sorted into cells: medians, and planes fitted in windows of cells."""

from lidar.gridding.cells.cells import CellReturns, sort_into_cells
from lidar.gridding.cells.planes import PlaneFit, fit_planes

__all__ = ["CellReturns", "PlaneFit", "fit_planes", "sort_into_cells"]
