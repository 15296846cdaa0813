from .initialise import new_workspace as new_workspace
from .workspace import OWN_FOLDERS as OWN_FOLDERS
from .workspace import SETTINGS_FILE as SETTINGS_FILE
from .workspace import SPC_FOLDERS as SPC_FOLDERS
from .workspace import SPC_LISTS as SPC_LISTS
from .workspace import Workspace as Workspace
from .workspace import make_folder as make_folder
