from .memory import PROGRAM_BYTES as PROGRAM_BYTES
from .memory import check_grid as check_grid
from .pages import announce as announce
from .pages import release as release
from .threads import one_blas_thread as one_blas_thread
