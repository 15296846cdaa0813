from .folders import clear_abandoned_folders as clear_abandoned_folders
from .folders import clear_leftovers as clear_leftovers
from .folders import make_folder as make_folder
from .folders import remove_folder as remove_folder
from .lock import LOCK_FILE as LOCK_FILE
from .lock import locked as locked
from .remembered import Remembered as Remembered
from .ticks import may_hide_a_change as may_hide_a_change
