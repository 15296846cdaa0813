from .cells import CellReturns as CellReturns
from .cells import sort_into_cells as sort_into_cells
from .planes import PlaneFit as PlaneFit
from .planes import fit_planes as fit_planes
