"""Commands that run stages: one by one, or all with ``spcola run``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from fusion.cli.folder import remember_info
from fusion.cli.options import RunOptions, WorkspaceArgument
from fusion.cli.output import run_lines, show
from fusion.service.commands.lithos import ImageFusionOptions, fuse_images
from fusion.service.commands.stages import (
    accepting,
    apply_scale_of,
    check_usable,
    pipeline_of,
)
from spcola.errors import SettingsError

if TYPE_CHECKING:
    from fusion.pipeline import Pipeline, StageRun
    from fusion.workspace.settings import Settings

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
    options: RunOptions = RunOptions(),
) -> None:
    """Grid lidar returns into mapolas: maplets of lidar heights.

    Each cell gets the median of slope-corrected heights, their count, spread and sigma.
    """
    _run(workspace, options, "mapolas", source=source, gsd_m=gsd)


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
    options: RunOptions = RunOptions(),
) -> None:
    """Register mapolas to the SPC surface.

    Each mapola is matched in three components, and one transform is fitted to all of them. The
    transform in registration.json maps lidar to SPC coordinates; its `inverse` maps SPC to lidar.
    """
    given = None if apply is None else str(apply.resolve())
    changed = {"model": model, "against": against, "by": by, "apply": given, "inverse": inverse}
    _run(workspace, options, "register", **changed)


def fuse(
    workspace: WorkspaceArgument,
    source: Annotated[
        Literal["maplets", "images"],
        typer.Option(
            "--from",
            help="Slopes come from the maplets; or maplets are solved anew from their images, with "
            "the lidar in every round.",
        ),
    ] = "maplets",
    name: Annotated[
        str,
        typer.Option(
            "--as",
            metavar="NAME",
            help="With --from images: name of the new solution, else spcola-1, ...",
        ),
    ] = "",
    options: RunOptions = RunOptions(),
) -> None:
    """Fuse maplets with lidar heights.

    Slopes are integrated with the registered lidar heights as constraints. Results are in fused/.
    With --from images, slopes, albedo and heights of each maplet are solved from the brightness of
    its images, and heights of lidar, shape and overlapping maplets are in the same equations. The
    result is a new solution; the one that is read stays as it is. [lithos] has the settings.
    Of the lidar single returns are used if the workspace has scans, else mapolas; "lidar"
    (mapolas) or "returns" in its constraints decides. "limbs" and "maps" there add those; shape,
    overlapping and coarser maplets always count.
    """
    check_source(source, name, force=options.force)
    if source == "images":
        given = ImageFusionOptions(options.only, options.within, options.accept, name)
        show(*fuse_images(options.site(workspace), given), as_json=options.as_json)
    else:
        _run(workspace, options, "fuse")


def check_source(source: str, name: str, *, force: bool) -> None:
    """Refuse options of ``spcola fuse`` that do not go together.

    Raises
    ------
    typer.BadParameter
        It names the option.
    """
    if name and source != "images":
        raise typer.BadParameter("is given without --from images", param_hint="--as")
    if force and source == "images":
        raise typer.BadParameter(
            "is not needed with --from images: each time is a new solution", param_hint="--force"
        )


def bigmap(
    workspace: WorkspaceArgument,
    options: RunOptions = RunOptions(),
) -> None:
    """Make bigmaps of fused maplets, of SPC maplets and of returns.

    One bigmap of each at every site of [bigmap] sites in spcola.toml; by default the two poles. In
    a solution without fused maplets those that were solved from images take their place.
    """
    _run(workspace, options, "bigmap")


def scale(
    workspace: WorkspaceArgument,
    method: Annotated[
        Literal["pairs", "shots"] | None,
        typer.Option(
            help=f"Paired bigmaps, or single shots against the shape: [scale] method. {_ONCE}"
        ),
    ] = None,
    apply: Annotated[
        bool,
        typer.Option(
            "--apply", help="Make a scaled solution from the one that is read, which is unchanged."
        ),
    ] = False,
    name: Annotated[
        str,
        typer.Option(
            "--as",
            metavar="NAME",
            help="With --apply: name of the new solution, else scaled-1, ...",
        ),
    ] = "",
    options: RunOptions = RunOptions(),
) -> None:
    """Estimate scale, centre and prime meridian.

    They come from paired bigmaps or single shots and are written with their sigmas to scale.json.
    Epsilon > 0 means that the SPC body is too small: ranges are longer than predicted by SPC's
    trajectory, and shorter than predicted by an independent one. With --apply a new
    solution is made: maplets, landmarks, states and shape with all lengths times 1 + epsilon. This
    is refused if epsilon is below three sigmas, not determined or not
    separable, unless --accept names that finding.
    """
    if name and not apply:
        raise typer.BadParameter("is given without --apply", param_hint="--as")
    if apply:
        _scale_and_apply(workspace, name, method, options)
    else:
        _run(workspace, options, "scale", method=method)


def _scale_and_apply(workspace: Path, name: str, method: str | None, options: RunOptions) -> None:
    """Bring the scale up to date, and make the scaled solution."""
    pipeline = _pipeline(workspace, options, "scale", method=method)
    ran, applied = apply_scale_of(pipeline, name, force=options.force)
    content = {**ran.as_json(), "applied": applied.as_dict()}
    show(content, [*run_lines(ran), *applied.lines()], as_json=options.as_json)
    remember_info(workspace)


def release(
    workspace: WorkspaceArgument,
    options: RunOptions = RunOptions(),
) -> None:
    """Write products, manifest and report.

    Every fused maplet and bigmap is written to release/ in every chosen format, with its
    provenance; in a solution without fused maplets those that were solved from images. report.html
    shows the results.
    """
    _run(workspace, options, "release", "report")


def report(
    workspace: WorkspaceArgument,
    options: RunOptions = RunOptions(),
) -> None:
    """Write report.html alone: what is there is shown.

    Verdicts, maps, surfaces, residuals and scale; of a solution from images the goodness of fit of
    each maplet and image, and images with their renderings.
    """
    _run(workspace, options, "report")


def run(
    workspace: WorkspaceArgument,
    forecast: Annotated[
        bool,
        typer.Option(
            "--forecast",
            help="Print what each stage will take in time, memory and disk, and run nothing. A few "
            "items are made to time them, and kept.",
        ),
    ] = False,
    options: RunOptions = RunOptions(),
) -> None:
    """Run all stages that are not up to date.

    An interrupted run resumes; after a change of settings or files, the stages that depend on it
    run again.
    """
    if options.only:
        raise typer.BadParameter(
            "names items of one stage: give it that command", param_hint="--only"
        )
    pipeline = _pipeline(workspace, options)
    if forecast:
        _forecast(pipeline, options)
        return
    runs = pipeline.run(force=options.force)
    _print(pipeline, runs, options)


def _forecast(pipeline: Pipeline, options: RunOptions) -> None:
    """Print what each stage will take.

    Raises
    ------
    typer.BadParameter
        With options for which there is no forecast.
    """
    from fusion.inspection.forecasts import forecast_json, forecast_lines, stage_forecasts

    given = {"--within": options.within, "--cluster": options.cluster, "--force": options.force}
    for name, value in given.items():
        if value:
            raise typer.BadParameter(f"does not know {name}", param_hint="--forecast")
    found = stage_forecasts(pipeline.workspace, pipeline.settings, workers=options.workers)
    forecasts = forecast_json(found)
    content = {"workspace": str(pipeline.workspace.root), "forecast": forecasts}
    show(content, forecast_lines(forecasts), as_json=options.as_json)


def _run(workspace: Path, options: RunOptions, *stages: str, **changed: Any) -> None:
    """Run stages with some settings of the first one's table changed (None: not changed)."""
    pipeline = _pipeline(workspace, options, stages[0], **changed)
    runs = [pipeline.run_stage(stage, force=options.force) for stage in stages]
    _print(pipeline, runs, options, alone=len(runs) == 1)


def _print(
    pipeline: Pipeline, runs: list[StageRun], options: RunOptions, *, alone: bool = False
) -> None:
    """Print what the stages did, and end with an error if a result may not be used."""
    found = [one.as_json() for one in runs]
    content = found[0] if alone else {"workspace": str(pipeline.workspace.root), "stages": found}
    show(content, [line for one in runs for line in run_lines(one)], as_json=options.as_json)
    remember_info(pipeline.workspace.root)
    check_usable(pipeline, runs)


def _pipeline(workspace: Path, options: RunOptions, table: str = "", **changed: Any) -> Pipeline:
    """Return all stages over a workspace, with some settings of one table changed."""
    site = options.site(workspace)
    settings = with_options(site.open().settings(), table, changed, options.accept or ())
    return pipeline_of(site, settings, only=options.only or (), within=options.within)


def with_options(
    settings: Settings, table: str, given: Mapping[str, Any], accept: Sequence[str]
) -> Settings:
    """Return settings with keys of one table, and accepted codes, as far as options give them.

    Raises
    ------
    typer.BadParameter
        If a value is not allowed; it names the option.
    """
    for key, value in given.items():
        if value is None:
            continue
        try:
            settings = settings.with_table(table, **{key: value})
        except SettingsError as error:
            option = f"--{_OPTIONS.get(key, key)}"
            raise typer.BadParameter(error.what, param_hint=option) from error
    try:
        return accepting(settings, accept)
    except SettingsError as error:
        raise typer.BadParameter(error.what, param_hint="--accept") from error
