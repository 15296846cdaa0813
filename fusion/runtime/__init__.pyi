from .cluster import ClusterExecutor as ClusterExecutor
from .executor import AHEAD as AHEAD
from .executor import Executor as Executor
from .executor import ThreadExecutor as ThreadExecutor
from .executor import usable_cores as usable_cores
from .json_values import json_text as json_text
from .json_values import json_value as json_value
from .progress import Progress as Progress
