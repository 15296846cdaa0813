"""Content of a file or a workspace, and time and memory that its stages will take."""

from fusion.inspection.describe import describe_file, describe_workspace
from fusion.inspection.forecast import mapolas_forecast
from fusion.inspection.foreign import name_content
from fusion.inspection.terrain import read_terrain

__all__ = [
    "describe_file",
    "describe_workspace",
    "mapolas_forecast",
    "name_content",
    "read_terrain",
]
