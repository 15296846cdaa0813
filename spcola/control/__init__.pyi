from .landmark import Landmark as Landmark
from .landmark import MapOverlap as MapOverlap
from .overlaps import map_overlap as map_overlap
from .overlaps import overlaps_of as overlaps_of
from .scaling import scaled as scaled
