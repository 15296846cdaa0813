"""Records of solutions: what each was made from, and which one is in use."""

from fusion.workspace.solution_records.record import (
    SolutionRecord,
    check_name,
    derived_names,
    name_in_use,
    read_record,
    read_solution,
    solution_folder,
    write_name_in_use,
    write_record,
)

__all__ = [
    "SolutionRecord",
    "check_name",
    "derived_names",
    "name_in_use",
    "read_record",
    "read_solution",
    "solution_folder",
    "write_name_in_use",
    "write_record",
]
