"""A workspace: the folder that holds an SPC solution, lidar scans and their results."""

from fusion.workspace.initialise import new_workspace, spc_files
from fusion.workspace.listing import visible_files
from fusion.workspace.solution_records.record import IMPORTED
from fusion.workspace.workspace import (
    OWN_FOLDERS,
    SETTINGS_FILE,
    SPC_FOLDERS,
    SPC_LISTS,
    Workspace,
)

__all__ = [
    "IMPORTED",
    "OWN_FOLDERS",
    "SETTINGS_FILE",
    "SPC_FOLDERS",
    "SPC_LISTS",
    "Workspace",
    "new_workspace",
    "spc_files",
    "visible_files",
]
