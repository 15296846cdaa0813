from .maplet import Maplet as Maplet
from .maplet import MapletGrid as MapletGrid
from .maplet import overlaps as overlaps
from .regrid import ProjectedMaplet as ProjectedMaplet
from .regrid import project_maplet as project_maplet
from .regrid import project_window as project_window
