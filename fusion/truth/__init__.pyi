from .demo import demonstrate as demonstrate
from .demo import errors_table as errors_table
from .demo import recovery_table as recovery_table
from .mission import make_mission as make_mission
from .planted import read_truth as read_truth
from .presets import PRESETS as PRESETS
from .restoring import changed as changed
from .size import mission_size as mission_size
