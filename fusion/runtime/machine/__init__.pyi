from .memory import PROGRAM_BYTES as PROGRAM_BYTES
from .memory import check_grid as check_grid
from .memory import check_memory as check_memory
from .pages import forget_pages as forget_pages
from .pages import read_ahead as read_ahead
from .threads import one_blas_thread as one_blas_thread
