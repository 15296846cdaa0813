from .fortran import LARGEST_NUMBER as LARGEST_NUMBER
from .source import KM as KM
from .source import read_bytes as read_bytes
from .source import regular_size as regular_size
from .source import whole_number as whole_number
