"""Commands that write: their options and what they do, for the command line and for jobs."""

from fusion.service.commands.fields import SolutionOption
from fusion.service.commands.site import Done, Site

__all__ = ["Done", "Site", "SolutionOption"]
