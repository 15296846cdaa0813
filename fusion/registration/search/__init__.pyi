from .directions import cells_of as cells_of
from .search import FrameSearch as FrameSearch
from .search import search_frames as search_frames
