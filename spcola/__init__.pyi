from .camera import SpcImage as SpcImage
from .camera import project_image as project_image
from .control import Landmark as Landmark
from .formats.maplets import read_maplet as read_maplet
from .formats.maplets import write_maplet as write_maplet
from .formats.shapes import read_shape as read_shape
from .formats.solution import read_landmark as read_landmark
from .formats.solution import read_summary as read_summary
from .grids import Maplet as Maplet
from .grids import MapletGrid as MapletGrid
from .heights import HeightProblem as HeightProblem
from .heights import posterior_sigma as posterior_sigma
from .heights import solve_heights as solve_heights
from .heights.slopes import slopes_of as slopes_of
from .heights.slopes import steps_from_slopes as steps_from_slopes
from .math import Similarity as Similarity
from .shape import Mesh as Mesh
from .shape import RayCaster as RayCaster

__version__: str
