from .landmarks import landmarks_of as landmarks_of
from .landmarks import measure_landmarks as measure_landmarks
from .solution import SolutionSettings as SolutionSettings
from .solution import heights_in_frame as heights_in_frame
from .solution import make_maplet as make_maplet
from .solution import maplet_directions as maplet_directions
from .solution import spc_shape as spc_shape
