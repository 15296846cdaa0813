"""``spcola sumfiles`` and ``spcola kernels``."""

from __future__ import annotations

from fusion.cli.folder import remember_info
from fusion.cli.options import JsonOption, WaitOption, WorkspaceArgument, site_of
from fusion.cli.output import show
from fusion.service.commands.states import (
    KernelsOptions,
    SumfilesOptions,
    make_kernels,
    make_states,
)


def sumfiles(
    workspace: WorkspaceArgument,
    given: SumfilesOptions = SumfilesOptions(),
    wait: WaitOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write .SUM and .NOM files of images from SPICE kernels, or .SUM files from a table of poses.

    Files that are there already are not replaced.
    With --compare the states are compared with those of the solution: along the track, across it
    and radially, in degrees and pixels.
    """
    given.check()
    site = site_of(workspace, wait=wait, as_json=as_json)
    show(*make_states(site, given), as_json=as_json)
    remember_info(workspace)


def kernels(
    workspace: WorkspaceArgument, given: KernelsOptions, as_json: JsonOption = False
) -> None:
    """Write SPICE kernels from the solved states of the images (.SUM files).

    An SPK and a CK with comments that state where they come from, PCK, FK, IK, a clock, a
    meta-kernel, and a table of the images. They are read back: each state must come back to 1 mm
    and 1 µrad.
    """
    show(*make_kernels(site_of(workspace, as_json=as_json), given), as_json=as_json)
