"""Points sorted into cubes of space."""

from lidar.scans.cubes.box import Box
from lidar.scans.cubes.cubes import (
    MOST_BITS,
    QUANTUM_M,
    CubedPoints,
    keep_inside,
    sort_into_cubes,
    touching_cubes,
    unpack_inside,
)

__all__ = [
    "MOST_BITS",
    "QUANTUM_M",
    "Box",
    "CubedPoints",
    "keep_inside",
    "sort_into_cubes",
    "touching_cubes",
    "unpack_inside",
]
