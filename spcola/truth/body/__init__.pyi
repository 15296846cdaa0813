from .body import BodySettings as BodySettings
from .body import TruthBody as TruthBody
from .streams import stream as stream
from .surface_points import SurfacePoints as SurfacePoints
from .terrain import BOULDER as BOULDER
from .terrain import CRATER as CRATER
from .terrain import SMOOTH as SMOOTH
