"""The stages in their order, and how to run them from Python, as the commands do."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from fusion.pipeline import Pipeline, Stage, StageRun, opened
from fusion.runtime import Executor, Progress, ThreadExecutor
from fusion.stages.ingest import STAGE, Imported, LidarFile, import_files
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings

# Names of stages, of their modules and of their commands, in the order of the data.
_ORDER = ("ingest", "mapolas", "register", "fuse", "bigmap", "scale", "release", "report")


def load_stages() -> list[Stage]:
    """Return all stages in the order in which data pass through them.

    Their modules are imported only now, so that commands start fast.
    """
    return [import_module(f"fusion.stages.{name}").STAGE for name in _ORDER]


def import_scans(
    workspace: Workspace,
    files: Sequence[LidarFile | str | Path],
    *,
    settings: Settings | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> list[Imported]:
    """Read lidar files into a workspace, as ``spcola import`` does.

    Parameters
    ----------
    workspace : Workspace
    files : sequence of LidarFile, str or Path
        A `LidarFile` also gives name, format, columns and unit.
    settings : Settings, optional
        By default those of ``spcola.toml``.
    executor, progress : optional
        By default all cores, and nothing printed.

    Returns
    -------
    list of Imported
        One for each file: its scan, and how many returns were left out and why. A file that was
        imported before is recognised by its content.

    Raises
    ------
    WorkspaceError
        If two files would get one name, or a file cannot be read.
    FormatError
        If a file does not have the content of its format.
    """
    chosen, workers = settings or workspace.settings(), executor or ThreadExecutor()
    shown = progress or Progress("silent")
    found = [file if isinstance(file, LidarFile) else LidarFile(Path(file)) for file in files]
    with opened(workspace) as catalog:
        done = import_files(workspace, chosen, found, catalog, executor=workers, progress=shown)
        catalog.update_digests(STAGE.name, [workspace.scan_path(one.scan.name) for one in done])
    Pipeline(workspace, chosen, [STAGE], workers, shown).run_stage(STAGE.name)
    return done


def run_stages(
    workspace: Workspace,
    *names: str,
    settings: Settings | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    force: bool = False,
) -> list[StageRun]:
    """Bring stages of a workspace up to date, as the commands of their names do.

    Parameters
    ----------
    workspace : Workspace
    *names : str
        Of "mapolas", "register", "fuse", "bigmap", "scale", "release", "report", in that order;
        all of them if none is named.
    settings : Settings, optional
        By default those of ``spcola.toml``; ``settings.with_table("mapolas", gsd_m=0.1)`` changes
        one for this run.
    executor, progress : optional
        By default all cores, and nothing printed.
    force : bool
        Run even what is up to date.

    Returns
    -------
    list of StageRun
        State, summary, and `obstacle`: why a result may not be used, empty if it may.

    Raises
    ------
    WorkspaceError
        If a stage lacks its inputs, or no stage has that name.
    SpcolaError
        If a stage fails.
    """
    pipeline = Pipeline(
        workspace,
        settings or workspace.settings(),
        load_stages(),
        executor or ThreadExecutor(),
        progress or Progress("silent"),
    )
    if not names:
        return pipeline.run(force=force)
    return [pipeline.run_stage(name, force=force) for name in names]
