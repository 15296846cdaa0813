"""A workspace: the folder in which an SPC solution and lidar scans meet."""

from fusion.workspace.initialise import new_workspace
from fusion.workspace.workspace import (
    OWN_FOLDERS,
    SETTINGS_FILE,
    SPC_FOLDERS,
    SPC_LISTS,
    Workspace,
    make_folder,
)

__all__ = [
    "OWN_FOLDERS",
    "SETTINGS_FILE",
    "SPC_FOLDERS",
    "SPC_LISTS",
    "Workspace",
    "make_folder",
    "new_workspace",
]
