"""Single shots compared with the shape."""

from fusion.scaling.shots.iteration import iterate_shots
from fusion.scaling.shots.shots import ShotComparison, compare_shots, join_shots
from fusion.scaling.shots.spots import SpotOptions

__all__ = ["ShotComparison", "SpotOptions", "compare_shots", "iterate_shots", "join_shots"]
