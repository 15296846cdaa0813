"""Versions of the SPC solution of a workspace, each made from another."""

from fusion.pipeline.solutions.export import export_solution
from fusion.pipeline.solutions.making import MadeBy, making_solution, solution_files
from fusion.pipeline.solutions.removal import remove_solution
from fusion.pipeline.solutions.solutions import (
    lineage,
    new_name,
    solutions_of,
    use_solution,
)

__all__ = [
    "MadeBy",
    "export_solution",
    "lineage",
    "making_solution",
    "new_name",
    "remove_solution",
    "solution_files",
    "solutions_of",
    "use_solution",
]
