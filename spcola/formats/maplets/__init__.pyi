from .map import read_map as read_map
from .map import read_maplet as read_maplet
from .map import sigma_path as sigma_path
from .map import write_maplet as write_maplet
from .sigma import read_sigma as read_sigma
