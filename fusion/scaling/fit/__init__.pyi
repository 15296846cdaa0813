from .joint import ScaleEstimate as ScaleEstimate
from .joint import ScaleOptions as ScaleOptions
from .joint import estimate_scale as estimate_scale
from .observation import Trajectory as Trajectory
