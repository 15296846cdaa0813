from .body import BodySettings as BodySettings
from .body import TruthBody as TruthBody
from .nearest import Nearest as Nearest
from .streams import stream as stream
from .terrain import BOULDER as BOULDER
from .terrain import CRATER as CRATER
from .terrain import SMOOTH as SMOOTH
