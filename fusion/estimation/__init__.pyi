from .leverage import influence as influence
from .mixed import fit_mixed as fit_mixed
from .rank import check_rank as check_rank
from .values import ErrorSizes as ErrorSizes
from .values import MixedFit as MixedFit
from .values import MixedOptions as MixedOptions
from .values import Observations as Observations
