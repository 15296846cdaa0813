"""Files outside of a workspace on which its stages depend."""

from __future__ import annotations

from pathlib import Path

from fusion.scene.geolocation import return_paths
from fusion.stages.ingest import recorded_origins
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings


def outside_files(workspace: Workspace, settings: Settings) -> list[Path]:
    """Return sources of scans, kernels, and the file of a given transform.

    Parameters
    ----------
    workspace : Workspace
    settings : Settings
    """
    sources = [origin.source.path for origin in recorded_origins(workspace).values()]
    apply = settings.registration.apply
    given = [workspace.root / apply] if apply else []
    return [*sources, *return_paths(workspace, settings), *given]
