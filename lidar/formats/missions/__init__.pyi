from .ola import RECORD as RECORD
from .ola import write_ola as write_ola
