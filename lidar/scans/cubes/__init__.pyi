from .box import Box as Box
from .cubes import MOST_BITS as MOST_BITS
from .cubes import QUANTUM_M as QUANTUM_M
from .cubes import CubedPoints as CubedPoints
from .cubes import cubed as cubed
from .cubes import keep_inside as keep_inside
from .cubes import touching as touching
from .cubes import unpack_inside as unpack_inside
