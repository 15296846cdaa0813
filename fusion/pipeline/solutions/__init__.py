"""Versions of the SPC solution of a workspace, each made from another."""

from fusion.pipeline.solutions.solutions import (
    MadeBy,
    export_solution,
    free_name,
    making_solution,
    remove_solution,
    solution_files,
    solutions_of,
    use_solution,
)

__all__ = [
    "MadeBy",
    "export_solution",
    "free_name",
    "making_solution",
    "remove_solution",
    "solution_files",
    "solutions_of",
    "use_solution",
]
