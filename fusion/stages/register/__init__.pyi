from .return_source import ReturnSource as ReturnSource
from .return_source import gridding_options as gridding_options
from .stage import STAGE as STAGE
