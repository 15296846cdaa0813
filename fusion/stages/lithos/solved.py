"""A solution whose maplets come from images."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fusion.pipeline.items import ItemStore, item_folder, whole_version
from fusion.pipeline.solutions import MadeBy, making_solution, new_name, solutions_of
from fusion.pipeline.solutions.lidar_content import LidarContent
from fusion.runtime import Executor, Progress, json_text
from fusion.runtime.remaining import Timed
from fusion.stages.bad_images import image_findings
from fusion.stages.lithos.constraint_findings import counted_twice
from fusion.stages.lithos.fits import Summary
from fusion.stages.lithos.options import LithosOptions
from fusion.stages.lithos.orientations import orientation_findings
from fusion.stages.lithos.other_functions import OtherFunctions
from fusion.stages.lithos.result import LithosResult, content_of, summary_of
from fusion.stages.lithos.sources import LithosSources
from fusion.workspace import Workspace
from spcola import atomic
from spcola.formats.image_sigmas import write_albedo_sigma, write_slope_sigma
from spcola.formats.maplets import write_maplet
from spcola.formats.slope_directions import SlopeDirections, write_slope_directions

# Raised whenever equal input gives other maplets.
_VERSION = 36


def lithos_solution(
    workspace: Workspace,
    name: str,
    options: LithosOptions,
    executor: Executor,
    progress: Progress,
    *,
    job: str = "",
) -> LithosResult:
    """Make a solution whose maplets come from their images; that of the workspace stays as it is.

    Each maplet depends on the parent solution alone, so that the result is the same in any order.
    Finished ones are kept until a run over all maplets ends: an interrupted one goes on where it
    was.

    Parameters
    ----------
    workspace : Workspace
    name : str
        Of the new solution; empty: ``lithos-1``, ``lithos-2``, …, or ``spcola-1``, …
    options : LithosOptions
    executor : Executor
    progress : Progress
    job : str, optional
        What asks for it, as the solution's record has it: the same one again gets the solution
        that it made before.

    Raises
    ------
    WorkspaceError
        If images, maplets, shape or registration are missing that are asked for, a solution of that
        name is there, or something cannot be read or written.
    InvalidValueError
        If the subset names no maplet.
    RejectedResultError
        If the lidar is asked for, and its registration may not be used.
    """
    file = workspace.photoclinometry_path.name
    if (made := solutions_of(workspace).of_job(job)) is not None:
        return LithosResult.read(workspace, made.name, made.parent, file)
    chosen = new_name(workspace, name, options.purpose.stem)
    started = time.time()
    # A solution with the lidar keeps its own: a run of the other command does not remove them.
    place = item_folder(workspace.home, options.purpose.stem)
    items = ItemStore(place, whole_version(_VERSION))
    sources = LithosSources.of(workspace, items, options)
    names = list(options.subset.chosen(sources.grids, sources.centers))
    facts: dict[str, Any] = {"lithos": sources.options.as_json(), **({"job": job} if job else {})}
    made_by = MadeBy(options.purpose.value, {}, facts, sources.input_digests(names))
    with making_solution(workspace, chosen, made_by) as folder:
        found = dict(_solved(sources, names, folder, executor, progress))
        use = sources.use({name: one.images for name, one in found.items()})
        turned = list(orientation_findings(sources, found, executor, progress))
        others = OtherFunctions.compared(sources, names, executor, progress)
        bad_images = [*turned, *image_findings(use)]
        content = content_of(found, facts["lithos"], sources.heights.names, bad_images)
        content |= {"photometry_ratios": others.as_json()}
        content["findings"] += others.findings()
        if options.uses_lidar_with_maplets and (twice := LidarContent.of(workspace)):
            content["findings"].append(counted_twice(twice, found))
        atomic.write_text(folder / file, json_text(content))
        facts |= {key: content[key] for key in ("outcomes", "residual_start", "residual")}
    if not options.subset:
        items.remove_unused(started)
    return LithosResult.read(workspace, chosen, workspace.solution, file)


def _solved(
    sources: LithosSources,
    names: list[str],
    folder: Path,
    executor: Executor,
    progress: Progress,
) -> Iterator[tuple[str, Summary]]:
    """Solve maplets, write those that are new, and yield their summaries."""
    grids = [sources.grids[name] for name in names]
    shown = [len(sources.showing(name)) for name in names]
    sizes = [float(grid.size**2 * (1 + k)) for grid, k in zip(grids, shown, strict=True)]
    with progress.items("maplets from images", sizes, executor.workers) as task:
        results = executor.stream(Timed(sources.solve), names)
        for name, (found, spent) in zip(names, results, strict=True):
            if not found.kept_start:
                path = folder / "MAPFILES" / f"{name}.MAP"
                write_maplet(path, found.maplet, sigma_companion=True)
                # Those of the parent's maplet would be linked.
                write_albedo_sigma(path, found.point_albedo_sigma)
                write_slope_sigma(path, found.slope_sigma)
                directions = SlopeDirections(found.directions, found.undetermined_azimuth_deg)
                write_slope_directions(path, directions)
            task.advance_one(spent)
            yield name, summary_of(found, sources.around(name))
