from .by_returns import SurfaceNormalEquations as SurfaceNormalEquations
from .by_returns import surface_equations as surface_equations
from .equations import Equations as Equations
from .equations import modelled_covariance as modelled_covariance
from .return_heights import CloudOfReturns as CloudOfReturns
from .return_heights import FixedSurface as FixedSurface
from .returns_match import match_returns as match_returns
