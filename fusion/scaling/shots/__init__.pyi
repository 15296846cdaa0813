from .iteration import iterate_shots as iterate_shots
from .shots import ShotComparison as ShotComparison
from .shots import compare_shots as compare_shots
from .shots import join_shots as join_shots
from .spots import SpotOptions as SpotOptions
