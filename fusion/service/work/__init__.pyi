from .logs import start_log as start_log
from .options import WorkOptions as WorkOptions
from .parameters import parameters_of as parameters_of
from .places import Places as Places
from .process import worker_command as worker_command
from .spc_folder import sent_files as sent_files
from .supervisor import Supervisor as Supervisor
from .worker import work as work
