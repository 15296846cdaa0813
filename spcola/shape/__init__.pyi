from .maplet_cover import covering as covering
from .mesh import Mesh as Mesh
from .rays import Hits as Hits
from .rays import RayCaster as RayCaster
from .samples import sample_surface as sample_surface
from .shape_grid import shape_heights as shape_heights
