from .bands import Bands as Bands
from .bands import usable_threads as usable_threads
from .cache import KernelCache as KernelCache
from .cache import is_kept as is_kept
from .decorators import compiled as compiled
from .decorators import compiled_inline as compiled_inline
from .decorators import compiled_sums as compiled_sums
