"""Files of a solution: landmarks, image states, nominal states, lists."""

from spcola.formats.solution.lists import read_list, write_list
from spcola.formats.solution.lmk import read_landmark, write_landmark
from spcola.formats.solution.nom import read_nominal, write_nominal
from spcola.formats.solution.sum import read_summary, write_summary

__all__ = [
    "read_landmark",
    "read_list",
    "read_nominal",
    "read_summary",
    "write_landmark",
    "write_list",
    "write_nominal",
    "write_summary",
]
