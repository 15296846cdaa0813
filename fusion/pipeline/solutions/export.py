"""A solution as a plain SPC folder."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

from fusion.pipeline.solutions.lidar_content import LidarContent
from fusion.pipeline.solutions.making import copy, solution_files
from fusion.runtime.folders import clear_abandoned_folders, make_folder
from fusion.workspace import Workspace, visible_files
from fusion.workspace.solution_records import read_solution, write_record
from spcola.atomic import write_error
from spcola.errors import WorkspaceError
from spcola.formats.solution.exact_camera import StoredCamera, exact_cameras


def export_solution(
    workspace: Workspace, folder: Path
) -> tuple[dict[str, int], dict[str, StoredCamera]]:
    """Write the solution of a workspace as a plain SPC folder, with the pixels of its images.

    ``solution.json`` has its constants, such as radius and pole, and whether its maplets contain
    the lidar, so that a workspace that is made of the folder has them again.

    Parameters
    ----------
    workspace : Workspace
    folder : Path
        Made; it must not exist, nor lie in the workspace.

    Returns
    -------
    counts : dict of str to int
        Number of files in each folder.
    cameras : dict of str to StoredCamera
        Exact cameras to which .SUM files have only a fit, by their files.

    Raises
    ------
    WorkspaceError
        If the folder exists, lies in the workspace, or cannot be written.
    FormatError
        If the exact camera of an image is missing or damaged.
    """
    _check_new(workspace, folder)
    record = read_solution(workspace.root, workspace.solution)
    content = LidarContent.of(workspace)
    facts = {**record.facts, **(content.facts if content else {})}
    record = replace(record, constants=_constants(workspace), facts=facts)
    files = {
        **solution_files(workspace),
        "IMAGEFILES": visible_files(workspace.root / "IMAGEFILES"),
    }
    cameras = exact_cameras(path for path in files["SUMFILES"] if path.suffix == ".SUM")
    making = folder.with_name(f".{folder.name}.{os.getpid()}")
    clear_abandoned_folders(folder)
    try:
        for name, paths in files.items():
            make_folder(making / name)
            for path in paths:
                copy(path, making / name / path.name)
        write_record(making, record)
        making.rename(folder)
    except OSError as error:
        raise write_error(folder, error) from error
    finally:
        shutil.rmtree(making, ignore_errors=True)
    return {name: len(paths) for name, paths in files.items() if name}, cameras


def _check_new(workspace: Workspace, folder: Path) -> None:
    """Refuse a folder that exists, or that stages of the workspace would read."""
    if folder.exists() or folder.is_symlink() or folder.resolve().exists():
        raise WorkspaceError("exists already", folder, "name a folder that does not exist")
    root, place = workspace.root.resolve(), folder.resolve()
    # No stage reads a hidden folder; the service keeps what jobs write in one.
    if place.is_relative_to(root) and not place.relative_to(root).parts[0].startswith("."):
        raise WorkspaceError("lies in the workspace", folder, "name a folder outside of it")


def _constants(workspace: Workspace) -> dict[str, Any]:
    """Return the settings of body and spin that are not the defaults."""
    return workspace.settings().model_dump(
        mode="json", by_alias=True, include={"body", "spin"}, exclude_defaults=True
    )
