from .image_choice import ChoiceOptions as ChoiceOptions
from .image_choice import choose_images as choose_images
from .sighting import Sighting as Sighting
from .sighting import SightOptions as SightOptions
from .sighting import agreeing as agreeing
from .sighting import find_ground as find_ground
from .sighting_sizes import SizeFactors as SizeFactors
from .sighting_sizes import estimate_factors as estimate_factors
