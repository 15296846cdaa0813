from .shared_errors import SHARED as SHARED
from .shared_errors import covariance_root as covariance_root
from .shared_errors import own_share as own_share
from .shared_errors import patterns_of as patterns_of
from .shared_errors import strongest as strongest
from .variance_components import most_likely_sizes as most_likely_sizes
