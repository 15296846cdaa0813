from .fit import FitOptions as FitOptions
from .fit import Model as Model
from .fit import Registration as Registration
from .fit import about_origin as about_origin
from .fit import natural_sizes as natural_sizes
from .fit import similarity_numbers as similarity_numbers
from .fit import transform_partials as transform_partials
from .fit import updated_transform as updated_transform
