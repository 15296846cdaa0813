from .fusing import FuseResult as FuseResult
from .fusing import fuse_maplet as fuse_maplet
from .fusing.maplets import FusedMaplet as FusedMaplet
from .scene import Scene as Scene
from .stages import import_scans as import_scans
from .stages import run_stages as run_stages
from .workspace import Workspace as Workspace
from .workspace import new_workspace as new_workspace
