"""``spcola import``."""

from __future__ import annotations

from dataclasses import replace

from fusion.cli.folder import remember_info
from fusion.cli.options import (
    ClusterOption,
    IsolateOptions,
    JsonOption,
    WorkersOption,
    WorkspaceArgument,
    shared_path,
    site_of,
)
from fusion.cli.output import show
from fusion.service.commands.altimetry import ImportOptions, import_lidar


def import_(
    workspace: WorkspaceArgument,
    given: ImportOptions,
    workers: WorkersOption = None,
    cluster: ClusterOption = "",
    isolation: IsolateOptions = IsolateOptions(),
    as_json: JsonOption = False,
) -> None:
    """Read lidar files into the workspace.

    Shots without an echo, returns flagged as bad and returns far from the shape are left out and
    counted by reason. A file that was imported before is recognised by its content.
    """
    isolation.apply(workspace)
    given.check()
    given = replace(given, files=[shared_path(file, cluster) for file in given.files])
    site = site_of(workspace, workers=workers, cluster=cluster, as_json=as_json)
    show(*import_lidar(site, given), as_json=as_json)
    remember_info(workspace)
