from .landmark import Landmark as Landmark
from .landmark import MapOverlap as MapOverlap
from .scaled_solution import scaled_image as scaled_image
from .scaled_solution import scaled_landmark as scaled_landmark
from .scaled_solution import scaled_maplet as scaled_maplet
from .scaled_solution import scaled_nominal as scaled_nominal
from .scaled_solution import scaled_shape as scaled_shape
