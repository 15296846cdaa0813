from .error_sizes import ErrorSizes as ErrorSizes
from .leverage import influence as influence
from .mixed import MixedFit as MixedFit
from .mixed import MixedOptions as MixedOptions
from .mixed import Observations as Observations
from .mixed import fit_mixed as fit_mixed
from .rank import check_rank as check_rank
