from .closest import Placement as Placement
from .closest import PointSurface as PointSurface
from .closest import fit_placement as fit_placement
from .directions import cells_of as cells_of
from .frame_texts import UNITS as UNITS
from .search import FrameSearch as FrameSearch
from .search import search_frames as search_frames
