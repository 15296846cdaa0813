from .stage import STAGE as STAGE
