from .adjusting import compared_grids as compared_grids
from .stage import STAGE as STAGE
from .stage import mapola_grids as mapola_grids
