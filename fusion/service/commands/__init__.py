"""Commands that write: their options and what they do, for the command line and for jobs."""

from fusion.service.commands.fields import FACES_FROM, SolutionOption
from fusion.service.commands.site import Done, Site

__all__ = ["FACES_FROM", "Done", "Site", "SolutionOption"]
