"""Content of a workspace and of its solutions, for ``spcola info``."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from typing import Any, NamedTuple

from fusion.inspection.import_forecast import BYTES_PER_RETURN
from fusion.pipeline import Pipeline
from fusion.pipeline.catalog import Catalog
from fusion.pipeline.catalog.soundness import judged
from fusion.pipeline.standing import FileRoles, Standing
from fusion.runtime import usable_cores
from fusion.runtime.machine import PROGRAM_BYTES
from fusion.stages import load_stages
from fusion.stages.images import count_images
from fusion.stages.ingest import duplicate_scans, readable_scans
from fusion.stages.line_scans import NOT_USED
from fusion.workspace import Workspace
from fusion.workspace.solution_records import read_solution
from lidar.formats.native import scan_summary
from spcola.errors import FormatError, SpcolaError

__all__ = ["WorkspaceFacts", "describe_solution", "describe_workspace", "workspace_facts"]


class WorkspaceFacts(NamedTuple):
    """What was found out about a workspace.

    Attributes
    ----------
    content : dict
        In JSON types.
    standings : mapping of str to Standing
        How each stage stands to its files.
    roles : FileRoles
        Which stages read and wrote which files when they last ran.
    scan_problems : list of str
        Those of the problems that are about scans.
    maplets : str
        Of what the others follow from (:attr:`Judged.kept`); empty if that is not kept.
    """

    content: dict[str, Any]
    standings: Mapping[str, Standing]
    roles: FileRoles
    scan_problems: list[str]
    maplets: str


def describe_workspace(workspace: Workspace) -> dict[str, Any]:
    """Return the content of a workspace and which stages are due.

    Raises
    ------
    SpcolaError
        If its settings are wrong, or a folder of it cannot be read.
    """
    return workspace_facts(workspace).content


def workspace_facts(workspace: Workspace) -> WorkspaceFacts:
    """Return what :func:`describe_workspace` does of a `workspace`, and what it rests on.

    Raises
    ------
    SpcolaError
        If its settings are wrong, or a folder of it cannot be read.
    """
    settings = workspace.settings()
    scans = list(readable_scans(workspace).values())
    per_worker = settings.ingest.chunk * BYTES_PER_RETURN
    shapes = sorted((workspace.home / "SHAPEFILES").glob("[!.]*"))
    pipeline = Pipeline(workspace, settings, load_stages())
    # Without the lock: a workspace can be read while another program works in it.
    with closing(Catalog(workspace, read_only=True)) as catalog:
        standings, records = pipeline.standings(catalog), catalog.records()
        roles = FileRoles.of_stages(
            {record.stage: record.inputs for record in records},
            {record.stage: record.outputs for record in records},
        )
        scan_problems = _scan_problems(workspace)
        maplet_problems, maplets = _maplet_problems(workspace, catalog)
        found = {
            "stages": {name: one.state for name, one in standings.items()},
            "problems": [*scan_problems, *maplet_problems],
            "finished": {record.stage: record.finished for record in records},
            "images_not_used": {
                record.stage: record.summary[NOT_USED]
                for record in records
                if NOT_USED in record.summary
            },
        }
    content = {
        "kind": "workspace",
        "body": settings.body.name,
        "solution": workspace.solution,
        "maplets": len(workspace.maplet_names()),
        "landmarks": len(workspace.landmark_names()),
        "images": len(workspace.image_names()),
        "line_scans": len(workspace.line_scan_names()),
        "images_in_catalogue": count_images(workspace),
        "shape": ", ".join(path.name for path in shapes),
        "scans": len(scans),
        "returns": sum(scan.count for scan in scans),
        "mapolas": len(workspace.mapola_names()),
        "fused": len(workspace.fused_names()),
        "import_memory_per_worker_mb": per_worker / 1e6,
        "import_memory_mb": (PROGRAM_BYTES + usable_cores() * per_worker) / 1e6,
        **found,
    }
    return WorkspaceFacts(content, standings, roles, scan_problems, maplets)


def describe_solution(workspace: Workspace) -> dict[str, Any]:
    """Return what the solution of a `workspace` was made from, and what it contains.

    Raises
    ------
    SpcolaError
        If its record or its constants are damaged.
    """
    record = read_solution(workspace.root, workspace.solution)
    # Its constants are checked.
    workspace.settings()
    return {
        **record.as_json(),
        "folder": str(workspace.home.relative_to(workspace.root)),
        "maplets": len(workspace.maplet_names()),
        "landmarks": len(workspace.landmark_names()),
        "images": len(workspace.image_names()),
        "line_scans": len(workspace.line_scan_names()),
    }


def _scan_problems(workspace: Workspace) -> list[str]:
    """Return what is wrong with scans, so that commands refuse them."""
    found = []
    for path in workspace.scan_paths():
        try:
            scan_summary(path)
        except FormatError as error:
            found.append(str(error))
    for one, other in duplicate_scans(readable_scans(workspace)):
        first, second = workspace.scan_path(one), workspace.scan_path(other)
        found.append(f"{first} and {second} hold the same scan")
    return found


def _maplet_problems(workspace: Workspace, catalog: Catalog) -> tuple[list[str], str]:
    """Return what is wrong with maplets, and what that follows from (:attr:`Judged.kept`)."""
    try:
        found = judged(workspace, catalog)
    except SpcolaError as error:
        return [str(error)], ""
    return [one.text for one in found.unsound], found.kept
