"""A workspace: the folder that holds an SPC solution, lidar scans and their results."""

from fusion.workspace.initialise import new_workspace
from fusion.workspace.workspace import (
    OWN_FOLDERS,
    SETTINGS_FILE,
    SPC_FOLDERS,
    SPC_LISTS,
    Workspace,
)

__all__ = [
    "OWN_FOLDERS",
    "SETTINGS_FILE",
    "SPC_FOLDERS",
    "SPC_LISTS",
    "Workspace",
    "new_workspace",
]
