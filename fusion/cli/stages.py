"""Commands that run stages: one by one, or all with ``spcola run``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from fusion.cli.output import JsonOption, run_content, run_lines, show
from spcola.errors import RejectedResultError, SettingsError

if TYPE_CHECKING:
    from fusion.pipeline import Pipeline, StageRun
    from fusion.runtime import Executor
    from fusion.workspace.settings import Settings

WorkspaceArgument = Annotated[Path, typer.Argument(metavar="WS", help="The workspace.")]
ForceOption = Annotated[bool, typer.Option("--force", help="Run even if up to date.")]
WorkersOption = Annotated[
    int | None,
    typer.Option(metavar="N", min=1, max=1024, help="Threads; by default one for each core."),
]
ClusterOption = Annotated[
    str,
    typer.Option(
        metavar="ADDRESS",
        help="Address of a Dask scheduler whose workers do the work. All must reach the workspace "
        "under the same path.",
    ),
]


AcceptOption = Annotated[
    list[str] | None,
    typer.Option(
        "--accept",
        metavar="CODE",
        help="Use a doubtful result, by the code that is printed with it. Repeat it for several. "
        "For this run only; [accept] codes in spcola.toml keeps it.",
    ),
]


@dataclass(frozen=True)
class RunOptions:
    """Options that all commands of stages share."""

    force: bool
    workers: int | None
    cluster: str
    accept: list[str] | None
    as_json: bool


# Options with other names than the keys of their tables.
_OPTIONS = {"gsd_m": "gsd"}
_ONCE = "For this run only; write it into spcola.toml to keep it."


def mapolas(
    workspace: WorkspaceArgument,
    source: Annotated[
        Literal["maplets", "cover"] | None,
        typer.Option(help=f"Centres of mapolas, [mapolas] source. {_ONCE}"),
    ] = None,
    gsd: Annotated[
        float | None,
        typer.Option(metavar="M", help=f"Ground sample distance, m: [mapolas] gsd_m. {_ONCE}"),
    ] = None,
    force: ForceOption = False,
    workers: WorkersOption = None,
    cluster: ClusterOption = "",
    accept: AcceptOption = None,
    as_json: JsonOption = False,
) -> None:
    """Grid lidar returns into mapolas: maplets of lidar heights.

    Each cell gets the median of slope-corrected heights, their count, spread and sigma.
    """
    changed = {"source": source, "gsd_m": gsd}
    _run(
        workspace,
        ("mapolas",),
        ("mapolas", changed),
        RunOptions(force, workers, cluster, accept, as_json),
    )


def register(
    workspace: WorkspaceArgument,
    model: Annotated[
        Literal["rigid", "similarity", "affine"] | None,
        typer.Option(help=f"Transform, [register] model: 6, 7 or 12 parameters. {_ONCE}"),
    ] = None,
    against: Annotated[
        Literal["maplets", "bigmap", "shape"] | None,
        typer.Option(help=f"SPC surface of the match, [register] against. {_ONCE}"),
    ] = None,
    by: Annotated[
        Literal["topography", "returns", "images", "both"] | None,
        typer.Option(
            help="What is matched, [register] by: heights of mapolas, returns themselves, images "
            f"rendered from mapolas, or heights and images. {_ONCE}",
        ),
    ] = None,
    apply: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Apply the transform of this registration.json instead of a fit, or of JSON with "
            "model, scale, rotation_deg and translation_m (V_spc = translation + scale R V_lidar): "
            f"[register] apply. {_ONCE}",
        ),
    ] = None,
    inverse: Annotated[
        bool | None,
        typer.Option(
            "--inverse/--no-inverse",
            help=f"That file transforms SPC to lidar coordinates: [register] inverse. {_ONCE}",
        ),
    ] = None,
    force: ForceOption = False,
    workers: WorkersOption = None,
    cluster: ClusterOption = "",
    accept: AcceptOption = None,
    as_json: JsonOption = False,
) -> None:
    """Register mapolas to the SPC surface.

    Each mapola is matched in three components, and one transform is fitted to all of them. The
    transform in registration.json maps lidar to SPC coordinates; its `inverse` maps SPC to lidar.
    """
    given = None if apply is None else str(apply.resolve())
    changed = {
        "model": model,
        "against": against,
        "by": by,
        "apply": given,
        "inverse": inverse,
    }
    _run(
        workspace,
        ("register",),
        ("register", changed),
        RunOptions(force, workers, cluster, accept, as_json),
    )


def fuse(
    workspace: WorkspaceArgument,
    force: ForceOption = False,
    workers: WorkersOption = None,
    cluster: ClusterOption = "",
    accept: AcceptOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fuse maplets with lidar heights.

    Slopes are integrated with the registered lidar heights as constraints. Results are in fused/.
    """
    _run(workspace, ("fuse",), ("fuse", {}), RunOptions(force, workers, cluster, accept, as_json))


def bigmap(
    workspace: WorkspaceArgument,
    force: ForceOption = False,
    workers: WorkersOption = None,
    cluster: ClusterOption = "",
    accept: AcceptOption = None,
    as_json: JsonOption = False,
) -> None:
    """Make bigmaps of fused maplets, of SPC maplets and of returns.

    One bigmap of each at every site of [bigmap] sites in spcola.toml; by default the two poles.
    """
    _run(
        workspace, ("bigmap",), ("bigmap", {}), RunOptions(force, workers, cluster, accept, as_json)
    )


def scale(
    workspace: WorkspaceArgument,
    destination: Annotated[
        Path | None,
        typer.Argument(metavar="DEST", help="With --apply: a new folder; by default WS-scaled."),
    ] = None,
    method: Annotated[
        Literal["pairs", "shots"] | None,
        typer.Option(
            help=f"Paired bigmaps, or single shots against the shape: [scale] method. {_ONCE}"
        ),
    ] = None,
    apply: Annotated[
        bool,
        typer.Option(
            "--apply", help="Write a scaled copy of the SPC solution; the original is unchanged."
        ),
    ] = False,
    force: ForceOption = False,
    workers: WorkersOption = None,
    cluster: ClusterOption = "",
    accept: AcceptOption = None,
    as_json: JsonOption = False,
) -> None:
    """Estimate scale, centre and prime meridian.

    They come from paired bigmaps or single shots and are written with their sigmas to scale.json.
    Epsilon > 0 means that the SPC body is too small: ranges are longer than predicted by SPC's
    trajectory, and shorter than predicted by an independent one. With --apply a new workspace is
    written: a copy of maplets, landmarks, states and shape with all lengths times 1 + epsilon, and
    the same scans. This is refused if epsilon is below three sigmas, not determined or not
    separable, unless --accept names that finding.
    """
    if destination is not None and not apply:
        raise typer.BadParameter("is given without --apply", param_hint="DEST")
    how = RunOptions(force, workers, cluster, accept, as_json)
    if apply:
        _scale_and_apply(workspace, destination, method, how)
    else:
        _run(workspace, ("scale",), ("scale", {"method": method}), how)


def _scale_and_apply(
    workspace: Path, destination: Path | None, method: str | None, how: RunOptions
) -> None:
    """Bring the scale up to date, and write the copy."""
    from fusion.stages.scale import apply_scale

    pipeline = _pipeline(workspace, ("scale", {"method": method}), how)
    root = pipeline.workspace.root
    target = destination or root.absolute().with_name(f"{root.absolute().name}-scaled")
    ran = pipeline.run_stage("scale", force=how.force)
    _end(pipeline, [ran])
    applied = apply_scale(
        pipeline.workspace, target, pipeline.progress, accepted=pipeline.settings.accept.codes
    )
    content = {**run_content(ran), "applied": applied.as_dict()}
    show(content, [*run_lines(ran), *applied.lines()], as_json=how.as_json)


def release(
    workspace: WorkspaceArgument,
    force: ForceOption = False,
    workers: WorkersOption = None,
    cluster: ClusterOption = "",
    accept: AcceptOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write products, manifest and report.

    Every product is written to release/ in every chosen format, with its provenance. report.html
    shows the results.
    """
    _run(
        workspace,
        ("release", "report"),
        ("release", {}),
        RunOptions(force, workers, cluster, accept, as_json),
    )


def run(
    workspace: WorkspaceArgument,
    force: ForceOption = False,
    workers: WorkersOption = None,
    cluster: ClusterOption = "",
    accept: AcceptOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run all stages that are not up to date.

    An interrupted run resumes; after a change of settings or files, the stages that depend on it
    run again.
    """
    pipeline = _pipeline(workspace, ("", {}), RunOptions(force, workers, cluster, accept, as_json))
    runs = pipeline.run(force=force)
    lines = [line for one in runs for line in run_lines(one)]
    show(_together(pipeline, runs), lines, as_json=as_json)
    _end(pipeline, runs)


def _run(
    workspace: Path,
    stages: tuple[str, ...],
    change: tuple[str, dict[str, Any]],
    how: RunOptions,
) -> None:
    """Run stages with some settings of one table changed (None: not changed), and print."""
    pipeline = _pipeline(workspace, change, how)
    runs = [pipeline.run_stage(stage, force=how.force) for stage in stages]
    content = run_content(runs[0]) if len(runs) == 1 else _together(pipeline, runs)
    show(content, [line for one in runs for line in run_lines(one)], as_json=how.as_json)
    _end(pipeline, runs)


def _end(pipeline: Pipeline, runs: list[StageRun]) -> None:
    """End with an error if a result may not be used, so that later stages did not run.

    Raises
    ------
    RejectedResultError
    """
    for run in runs:
        if run.obstacle:
            raise RejectedResultError(
                f"the result of {run.stage} is {run.obstacle}", pipeline.workspace.root
            )


def executor(workers: int | None, cluster: str) -> Executor:
    """Return the executor: threads of this machine, or a cluster.

    Raises
    ------
    typer.BadParameter
        If both are chosen.
    SettingsError
        If the cluster cannot be used.
    """
    if not cluster:
        from fusion.runtime import ThreadExecutor

        return ThreadExecutor(workers)
    if workers is not None:
        raise typer.BadParameter("a cluster has its own workers", param_hint="--workers")
    try:
        from fusion.runtime import ClusterExecutor
    except ImportError as error:
        raise SettingsError(
            "needs Dask", "--cluster", "install it: pip install 'spcola[cluster]'"
        ) from error
    return ClusterExecutor(cluster)


def shared_path(path: Path, cluster: str) -> Path:
    """Return a path that is valid for the workers of a cluster in their folder too."""
    return path.absolute() if cluster else path


def _pipeline(workspace: Path, change: tuple[str, dict[str, Any]], how: RunOptions) -> Pipeline:
    """Return all stages over a workspace, with some settings of one table changed."""
    # Imported here and not above, so that --help is fast.
    from fusion.pipeline import Pipeline
    from fusion.runtime import Progress
    from fusion.stages import load_stages
    from fusion.workspace import Workspace

    table, changed = change
    opened = Workspace.open(shared_path(workspace, how.cluster))
    settings = opened.settings()
    given = {key: value for key, value in changed.items() if value is not None}
    settings = _changed(settings, table, given)
    if how.accept:
        try:
            settings = settings.with_table("accept", codes=[*settings.accept.codes, *how.accept])
        except SettingsError as error:
            raise typer.BadParameter(error.what, param_hint="--accept") from error
    progress = Progress.fitting(silent=how.as_json)
    workforce = executor(how.workers, how.cluster)
    return Pipeline(opened, settings, load_stages(), workforce, progress)


def _changed(settings: Settings, table: str, given: dict[str, Any]) -> Settings:
    """Return settings with keys of one table replaced by options.

    Raises
    ------
    typer.BadParameter
        If a value is not allowed; it names the option.
    """
    for key, value in given.items():
        try:
            settings = settings.with_table(table, **{key: value})
        except SettingsError as error:
            option = f"--{_OPTIONS.get(key, key)}"
            raise typer.BadParameter(error.what, param_hint=option) from error
    return settings


def _together(pipeline: Pipeline, runs: list[StageRun]) -> dict[str, Any]:
    """Return the content of ``--json`` for several stages."""
    return {"workspace": str(pipeline.workspace.root), "stages": [run_content(one) for one in runs]}
