from .compiling import compiling_ahead as compiling_ahead
from .loading import load_stages as load_stages
from .running import import_scans as import_scans
from .running import run_stages as run_stages
