"""``spcola init`` and ``spcola info``."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from fusion.cli.options import IsolateOptions, JsonOption
from fusion.cli.output import show, value_lines
from fusion.service.commands import FACES_FROM
from spcola.errors import SpcolaError

if TYPE_CHECKING:
    from fusion.runtime.folders.remembered import Listing, Renewal
    from fusion.workspace import Workspace

# With so many files `spcola info` does not measure how long stages take, and is known already after
# a command. Longer than a tick of the clock of most file systems, s.
_MANY_FILES, _TICK_S = 20_000, 0.02
_FORECASTS = ("mapolas_forecast", "forecast")


def init(
    workspace: Annotated[Path, typer.Argument(metavar="WS", help="The folder of the workspace.")],
    spc: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="An SPC working folder (MAPFILES, LMKFILES, SUMFILES ...). Its files are linked "
            "into the workspace, not copied. WS may be the same folder.",
        ),
    ] = None,
    shape: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A shape model (ICQ, OBJ or PLY); it is copied."),
    ] = None,
    unit: Annotated[
        Literal["km", "m"], typer.Option(help="Unit of the coordinates of an OBJ or PLY shape.")
    ] = "km",
    faces_from: Annotated[int, FACES_FROM] = 1,
    body: Annotated[str, typer.Option(metavar="NAME", help="Name of the body.")] = "body",
    isolation: IsolateOptions = IsolateOptions(),
    as_json: JsonOption = False,
) -> None:
    """Make a workspace: folders and settings.

    All settings, with defaults and meanings, are written to spcola.toml. Existing files in the
    folder are unchanged.
    """
    # Imported here and not above, so that --help is fast.
    from fusion.workspace import SETTINGS_FILE, new_workspace

    isolation.apply(workspace)
    if spc is not None and shape is not None:
        raise typer.BadParameter("give --spc or --shape, not both", param_hint="--shape")
    made = new_workspace(
        workspace,
        body=body,
        spc=spc,
        shape=shape,
        shape_unit=unit,
        faces_from=0 if faces_from == 0 else 1,
    )
    content = _described(made)
    lines = [
        f"Made {made.root} ({body}): {content['maplets']} maplets, {content['landmarks']} "
        f"landmarks, {content['images']} images, shape: {content['shape'] or 'none'}",
        f"Its settings are in {made.root / SETTINGS_FILE}. Next: spcola import {made.root} FILE...",
    ]
    if shape is not None and (remark := made.shape().remark):
        lines.append(f"The shape: {remark} ([body] icq_edges).")
    show(content, lines, as_json=as_json)


def info(
    path: Annotated[
        Path, typer.Argument(metavar="WS|FILE", help="A workspace, or any file SPCOLA reads.")
    ],
    faces_from: Annotated[int, FACES_FROM] = 1,
    isolation: IsolateOptions = IsolateOptions(),
    as_json: JsonOption = False,
) -> None:
    """Describe a workspace or a file.

    Of a workspace: its content, stages that are not up to date, and a forecast of time, memory and
    disk for each of these. A few of their items are made to measure the time, and kept. With over
    20,000 files that is left to run --forecast. Nothing is looked at again as long as no file
    changes.
    """
    isolation.apply(path)
    if path.is_dir():
        content, lines = _workspace_info(path)
    else:
        from fusion.inspection import describe_file

        content = describe_file(path, faces_from=0 if faces_from == 0 else 1)
        lines = value_lines(content)
    show(content, [str(path), *lines], as_json=as_json)


def _workspace_info(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Return content and lines about a workspace: remembered, or found out now."""
    # What is remembered needs few of the program's modules, which take a second to import.
    from fusion.runtime.folders import Remembered

    remembered = Remembered(path)
    before = remembered.listing()

    def renewed(found: Renewal) -> dict[str, Any] | None:
        return _renewed(path, found, has_forecast=_has_forecast(before))

    if found := remembered.find(before, renewed=renewed):
        return found["content"], found["lines"]
    return _found_out(path, before)


def _described(made: Workspace) -> dict[str, Any]:
    """Return the content of a new workspace; one with very many files is remembered for `info`."""
    from fusion.pipeline.catalog import RECORD_FOLDER
    from fusion.runtime.folders import Remembered, make_folder

    # What changed within the last tick of the clock cannot be remembered.
    time.sleep(_TICK_S)

    files = Remembered(made.root).listing()
    if _has_forecast(files):
        from fusion.inspection import describe_workspace

        return describe_workspace(made)
    make_folder(made.root / RECORD_FOLDER)
    content, _ = _found_out(made.root, files)
    return {key: value for key, value in content.items() if key not in _FORECASTS}


def remember_info(path: Path) -> None:
    """Find out what `info` prints after a command changed a workspace with very many files.

    `info` then answers at once. Where that fails, `info` finds it out itself and says why.
    """
    from fusion.runtime.folders import Remembered

    if _has_forecast(Remembered(path).listing()):
        return
    # What changed within the last tick of the clock cannot be remembered.
    time.sleep(_TICK_S)
    with suppress(SpcolaError, OSError):
        _found_out(path, Remembered(path).listing())


def _has_forecast(files: Listing) -> bool:
    """Return whether a workspace has so few files that its stages are forecast at once."""
    return len(files.files) < _MANY_FILES


def _found_out(path: Path, before: Listing) -> tuple[dict[str, Any], list[str]]:
    """Return content and lines about a workspace, and remember them for the files `before`."""
    from fusion.inspection import outside_files
    from fusion.inspection.workspace_facts import workspace_facts
    from fusion.runtime.folders import Remembered
    from fusion.workspace import Workspace

    opened = Workspace.open(path)
    facts, settings = workspace_facts(opened), opened.settings()
    forecast, mapolas = dict[str, Any](), dict[str, Any]()
    # No forecast for a workspace whose stages refuse it.
    if _has_forecast(before) and not facts.content["problems"]:
        from fusion.inspection.forecasts import forecast_json, stage_forecasts

        found = stage_forecasts(opened, settings, states=facts.content["stages"])
        forecast, mapolas = forecast_json(found), dict(found["mapolas"].details)
    content, lines = _with_forecast(path, facts.content, forecast, mapolas)
    standings = [one.as_json() for one in facts.standings.values()]
    kept = {
        "content": content,
        "lines": lines,
        "home": opened.home,
        "standings": standings,
        "scan_problems": facts.scan_problems,
        "maplets": facts.maplets,
    }
    outside = outside_files(opened, settings)
    Remembered(path).keep(before, kept, outside, {"roles": facts.roles.as_json()})
    return content, lines


def _with_forecast(
    path: Path, content: dict[str, Any], forecast: dict[str, Any], mapolas: dict[str, Any]
) -> tuple[dict[str, Any], list[str]]:
    """Return content of the workspace at `path` and lines, with a forecast or how to get one.

    `mapolas` are further numbers of the forecast of mapolas.
    """
    lines = value_lines({k: value for k, value in content.items() if k not in _FORECASTS})
    if forecast:
        from fusion.inspection.forecasts import forecast_lines

        lines += ["  forecast:", *(f"    {line}" for line in forecast_lines(forecast))]
    elif not content["problems"]:
        lines.append(f"  forecast: spcola run {path} --forecast")
    return {**content, "mapolas_forecast": mapolas, "forecast": forecast}, lines


def _renewed(path: Path, found: Renewal, *, has_forecast: bool) -> dict[str, Any] | None:
    """Return what is remembered with some files written; None if it has to be found out anew.

    If only the content of stages' results, of maplets and of landmarks has changed, so may have the
    states of stages, what is wrong with maplets, and the forecast, but nothing else.
    """
    from fusion.pipeline.catalog import digests_of_written
    from fusion.pipeline.standing import FileRoles, Standing, standings_after

    kept = found.content
    digests = digests_of_written(found.written, Path(kept["home"]))
    if digests is None:
        return None
    changed = [one for one in digests if one.now != one.before]
    if not changed:
        return kept
    standings = [Standing.from_json(one) for one in kept["standings"]]
    roles = FileRoles.from_json(found.details["roles"])
    maplets = [one for one in changed if _is_of_a_maplet(one.name)]
    plain = {one.name for one in maplets}
    after = None if has_forecast else standings_after(standings, roles, changed, plain)
    if after is None or (judged := _problems_after(kept, maplets)) is None:
        return None
    problems, rows = judged
    stages = {one.stage: one.state for one in after}
    content = {**kept["content"], "problems": problems, "stages": stages}
    content, lines = _with_forecast(path, content, {}, {})
    now = {"content": content, "lines": lines, "standings": [one.as_json() for one in after]}
    return {**kept, **now, "maplets": rows}


def _problems_after(
    kept: Mapping[str, Any], maplets: Sequence[tuple[str, str, str]]
) -> tuple[list[str], str] | None:
    """Return problems after files of maplets changed, and what those of maplets follow from.

    None if that has to be found out anew, as for a maplet that cannot be read.
    """
    if not maplets:
        return kept["content"]["problems"], kept.get("maplets", "")
    from fusion.pipeline.catalog.soundness import judged_after

    try:
        found = judged_after(Path(kept["home"]), kept.get("maplets", ""), maplets)
    except SpcolaError:
        return None
    if found is None:
        return None
    return [*kept["scan_problems"], *(one.text for one in found.unsound)], found.kept


def _is_of_a_maplet(name: str) -> bool:
    """Return whether a file, by its name in the catalogue, is a maplet or a landmark."""
    return PurePath(name).match("MAPFILES/*.MAP") or PurePath(name).match("LMKFILES/*.LMK")
