from .pipeline import Pipeline as Pipeline
from .pipeline import StageRun as StageRun
from .pipeline import opened as opened
from .stage import Stage as Stage
from .stage import StageContext as StageContext
from .stage import StageResult as StageResult
from .stage import find_table as find_table
