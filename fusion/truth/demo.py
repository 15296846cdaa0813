"""The demonstration: a synthetic mission through all stages, and the recovered parameters."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from fusion.pipeline import Pipeline, StageRun, opened
from fusion.report import fused_places
from fusion.report.planted import RecoveredParameter, SurfaceErrors, write_planted
from fusion.runtime import Executor, Progress
from fusion.runtime.folders import make_folder
from fusion.stages import compiling_ahead, load_stages
from fusion.stages.ingest import LidarFile, import_files
from fusion.truth.causes import LARGE_PULL, explained
from fusion.truth.generation import LIDAR_FOLDER, SPC_FOLDER
from fusion.truth.mission import make_mission
from fusion.truth.planted import TRUTH_FILE, Planted, read_truth
from fusion.truth.presets import MissionSettings
from fusion.truth.recovery import compare
from fusion.truth.surface_errors import surface_errors
from fusion.workspace import SETTINGS_FILE, Workspace, new_workspace
from spcola.errors import FormatError, WorkspaceError
from spcola.truth.body import TruthBody

MISSION_FOLDER, WORKSPACE_FOLDER = "mission", "workspace"
REPORT = "report"


@dataclass(frozen=True)
class Demonstration:
    """Results of the demonstration.

    Attributes
    ----------
    workspace : Workspace
    runs : list of StageRun
    recovered : list of RecoveredParameter
        Planted and recovered values.
    errors : list of SurfaceErrors
        How far SPC, lidar and fused heights are from the true ones.
    """

    workspace: Workspace
    runs: list[StageRun]
    recovered: list[RecoveredParameter]
    errors: list[SurfaceErrors]

    def as_dict(self) -> dict[str, Any]:
        """Return all of it in JSON types."""
        return {
            "workspace": str(self.workspace.root),
            "report": str(self.workspace.report_path),
            "stages": [asdict(run) for run in self.runs],
            "recovered": [{**asdict(row), "pull": row.pull} for row in self.recovered],
            "errors": [asdict(row) for row in self.errors],
        }


@compiling_ahead()
def demonstrate(
    folder: Path,
    executor: Executor,
    progress: Progress,
    *,
    settings: MissionSettings | None = None,
) -> Demonstration:
    """Make a mission in `folder`, run all stages on it, and compare with what was planted.

    An existing mission and workspace of an earlier demo are used again; if the mission has to
    be made again, the workspace of the old one is removed.

    Raises
    ------
    WorkspaceError
        If `folder` holds other things, or cannot be written.
    """
    known = (MISSION_FOLDER, WORKSPACE_FOLDER)
    if folder.is_dir() and any(entry.name not in known for entry in folder.iterdir()):
        raise WorkspaceError("holds other things than a demo", folder, "choose an empty folder")
    make_folder(folder)
    mission = folder / MISSION_FOLDER
    planted = _mission(folder, settings or MissionSettings.demo(), executor, progress)
    workspace = _workspace(folder / WORKSPACE_FOLDER, mission)
    chosen = workspace.settings()
    sources = [LidarFile(path) for path in sorted((mission / LIDAR_FOLDER).iterdir())]
    with opened(workspace) as catalog:
        import_files(workspace, chosen, sources, catalog, executor=executor, progress=progress)
    stages = load_stages()
    whole = Pipeline(workspace, chosen, stages, executor, progress)
    # The report comes last: it shows the recovered values.
    runs = replace(whole, stages=[stage for stage in stages if stage.name != REPORT]).run()
    recovered, errors = _recovered(planted, workspace), _errors(planted, workspace)
    write_planted(workspace, recovered, errors)
    return Demonstration(workspace, [*runs, whole.run_stage(REPORT)], recovered, errors)


def _recovered(planted: Planted, workspace: Workspace) -> list[RecoveredParameter]:
    """Return what was planted and what was found of it, large pulls explained."""
    scale = workspace.read_json(workspace.scale_path.name)
    found = compare(planted, workspace.read_json(workspace.registration_path.name), scale)
    return explained(found, planted, workspace, scale)


def _errors(planted: Planted, workspace: Workspace) -> list[SurfaceErrors]:
    """Return how far the three surfaces are from the true one."""
    return surface_errors(
        planted,
        (
            (
                place.fused.grid,
                {"SPC": place.spc, "lidar": place.lidar, "fused": place.fused.height},
            )
            for place in fused_places(workspace)
        ),
    )


def errors_table(errors: Sequence[SurfaceErrors]) -> Iterator[str]:
    """Yield the lines of a table: what each surface covers, and how far it is from the true one."""
    yield f"{'heights against the true ones':30}{'cover':>7}" + "".join(
        f"{head:>{width}}" for head, width in (("68 % below", 13), ("95 % below", 13), ("rms", 9))
    )
    for one in errors:
        sizes = (one.within_68_m, one.within_95_m, one.rms_m)
        cells = "".join(
            f"{size:>{width}.3f} m" for size, width in zip(sizes, (11, 11, 7), strict=True)
        )
        yield f"{one.name:30}{100 * one.share:>5.0f} %{cells}"


def recovery_table(rows: Sequence[RecoveredParameter]) -> Iterator[str]:
    """Yield the lines of a table: planted, recovered, sigma, and their difference in sigmas.

    A line for each parameter beyond :data:`LARGE_PULL` sigma says why, as far as that is known.
    """
    yield f"{'':28}{'planted':>12}{'recovered':>12}{'sigma':>11}{'off by':>9}"
    for row in rows:
        values = "".join(
            f"{_figure(value):>{width}}"
            for value, width in ((row.planted, 12), (row.recovered, 12), (row.sigma, 11))
        )
        off = "" if math.isnan(row.pull) else f"{row.pull:+.1f} σ"
        yield f"{row.name:28}{values}{off:>9}{'  ' + row.unit if row.unit else ''}".rstrip()
    large = [row for row in rows if row.explanation]
    yield f"beyond {LARGE_PULL:g} σ: {len(large) or 'none'}"
    yield from (f"  {row.name}, {row.pull:+.1f} σ: {row.explanation}" for row in large)


def _figure(value: float) -> str:
    """Return a number in at most ten characters; numbers near 1 with seven decimals."""
    if math.isnan(value):
        return "unknown"
    if 0.9 < abs(value) < 1.1:
        return f"{value:.7f}"
    return f"{value:.3e}" if 0 < abs(value) < 1e-3 else f"{value:.5f}"


def _mission(
    folder: Path, wanted: MissionSettings, executor: Executor, progress: Progress
) -> Planted:
    """Return what is planted in the demo's mission, made unless it is there."""
    mission = folder / MISSION_FOLDER
    planted = _planted(mission, wanted, progress)
    if planted is not None:
        return planted
    # What was made of another mission (an earlier version's, say) says nothing of this one.
    # A workspace without a mission next to it was not made by a demo.
    if (folder / WORKSPACE_FOLDER).exists() and not (mission / TRUTH_FILE).exists():
        raise WorkspaceError("holds other things than a demo", folder, "choose an empty folder")
    _remove(folder / WORKSPACE_FOLDER)
    return make_mission(
        mission, settings=wanted, executor=executor, progress=progress, replace=True
    )


def _planted(mission: Path, settings: MissionSettings, progress: Progress) -> Planted | None:
    """Return what is planted in an existing mission; None if it is incomplete or another one."""
    if not (mission / TRUTH_FILE).is_file():
        return None
    try:
        planted = read_truth(mission)
    except FormatError as error:
        progress.note(f"note: {error}")
        return None
    same = planted.is_of(settings, TruthBody(settings.body).fingerprint)
    return planted if same else None


def _remove(folder: Path) -> None:
    """Remove a folder, if it exists."""
    try:
        if folder.exists():
            shutil.rmtree(folder)
    except OSError as error:
        raise WorkspaceError(f"cannot be removed ({error.strerror})", folder) from error


def _workspace(root: Path, mission: Path) -> Workspace:
    """Return the workspace at `root`, made over the mission's SPC folder unless it exists."""
    if (root / SETTINGS_FILE).is_file():
        return Workspace.open(root)
    return new_workspace(root, body="Truth", spc=mission / SPC_FOLDER)
