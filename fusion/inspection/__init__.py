"""Content of a file or a workspace, and time and memory that its stages will take."""

from fusion.inspection.describe import describe_file, describe_solution, describe_workspace
from fusion.inspection.foreign import name_content
from fusion.inspection.outside import outside_files
from fusion.inspection.solution_difference import (
    SolutionDifference,
    difference_lines,
    solution_difference,
)
from fusion.inspection.terrain import read_terrain

__all__ = [
    "SolutionDifference",
    "describe_file",
    "describe_solution",
    "describe_workspace",
    "difference_lines",
    "name_content",
    "outside_files",
    "read_terrain",
    "solution_difference",
]
