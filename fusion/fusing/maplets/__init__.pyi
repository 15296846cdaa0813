from .bigmap import fused_bigmap as fused_bigmap
from .maplet import FusedMaplet as FusedMaplet
from .maplet import Source as Source
from .store import FUSED_HDF5 as FUSED_HDF5
from .store import fused_names as fused_names
from .store import read_fused as read_fused
from .store import write_fused as write_fused
