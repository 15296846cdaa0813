from .exposures import Exposures as Exposures
from .surfaces import Reference as Reference
from .surfaces import maplets_around as maplets_around
from .surfaces import surface_reference as surface_reference
