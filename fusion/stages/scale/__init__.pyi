from .rescaling import apply_scale as apply_scale
from .stage import STAGE as STAGE
