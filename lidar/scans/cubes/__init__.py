"""Points sorted into cubes of space."""

from lidar.scans.cubes.box import Box
from lidar.scans.cubes.cubes import (
    MOST_BITS,
    QUANTUM_M,
    CubedPoints,
    cubed,
    keep_inside,
    touching,
    unpack_inside,
)

__all__ = [
    "MOST_BITS",
    "QUANTUM_M",
    "Box",
    "CubedPoints",
    "cubed",
    "keep_inside",
    "touching",
    "unpack_inside",
]
