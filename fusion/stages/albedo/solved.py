"""Albedo on known topography: of maplets and mapolas in a new solution, or of bigmaps."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from fusion.pipeline.catalog import file_digest
from fusion.pipeline.items import ItemStore, item_folder, whole_version
from fusion.pipeline.solutions import MadeBy, making_solution, new_name, solutions_of
from fusion.runtime import Executor, Progress, json_text
from fusion.runtime.folders import LOCK_FILE, locked, make_folder
from fusion.runtime.remaining import Timed
from fusion.scene import Scene
from fusion.stages.albedo.landmarks import write_landmarks
from fusion.stages.albedo.options import AlbedoWork
from fusion.stages.albedo.placing import placed_mapolas
from fusion.stages.albedo.result import ALBEDO_FILE, AlbedoResult, content_of, summary_of
from fusion.stages.albedo.sources import AlbedoSources
from fusion.stages.albedo.surfaces import Surfaces
from fusion.stages.bad_images import image_findings
from fusion.stages.lithos.constraining import check_registration
from fusion.stages.lithos.fits import Summary
from fusion.stages.tiling.naming import free_letters, free_names
from fusion.workspace import Workspace
from spcola import atomic
from spcola.photometry.albedo import AlbedoOutcome

# Raised whenever equal input gives another albedo.
_VERSION = 4
_STEM = "albedo"
_COMMAND = "spcola spc albedo"
# Where bigmaps with solved albedo lie.
_BIGMAPS = "bigmaps/albedo"


def albedo_solution(
    workspace: Workspace,
    name: str,
    work: AlbedoWork,
    executor: Executor,
    progress: Progress,
    *,
    job: str = "",
) -> AlbedoResult:
    """Make a solution whose maplets have a new albedo, or that has mapolas as maplets.

    Heights stay as they are; so does the solution of the workspace. Finished surfaces are kept
    until a run over all of them ends: an interrupted one goes on where it was.

    Parameters
    ----------
    workspace : Workspace
    name : str
        Of the new solution; empty: ``albedo-1``, ``albedo-2``, …
    work : AlbedoWork
        Of maplets or mapolas.
    executor : Executor
    progress : Progress
    job : str, optional
        What asks for it, as the solution's record has it: the same one again gets the solution
        that it made before.

    Raises
    ------
    WorkspaceError
        If images, maplets or the registration are missing that are asked for, a solution of that
        name is there, or something cannot be read or written.
    InvalidValueError
        If the subset names nothing.
    RejectedResultError
        If mapolas are asked for, and their registration may not be used.
    """
    if (made := solutions_of(workspace).of_job(job)) is not None:
        return AlbedoResult.read(workspace, made.name, made.parent, ALBEDO_FILE)
    chosen = new_name(workspace, name, _STEM)
    started = time.time()
    make = _mapolas if work.ground == "mapolas" else _maplets
    sources, surfaces = make(workspace, work, executor, progress)
    options = sources.work.as_json()
    facts: dict[str, Any] = {"albedo": options, **({"job": job} if job else {})}
    digests = sources.input_digests(surfaces.grids.values())
    if surfaces.placed:
        digests[workspace.registration_path.name] = file_digest(workspace.registration_path)
    with making_solution(workspace, chosen, MadeBy(_COMMAND, {}, facts, digests)) as folder:
        found = dict(_solved(sources, surfaces, folder / "MAPFILES", executor, progress))
        if surfaces.placed:
            write_landmarks(workspace, folder, list(surfaces.placed.values()))
        content = content_of(found, options, _bad_images(sources, surfaces, found))
        atomic.write_text(folder / ALBEDO_FILE, json_text(content))
        facts |= {key: content[key] for key in ("outcomes", "residual_start", "residual")}
    if not work.subset:
        sources.items.remove_unused(started)
    return AlbedoResult.read(workspace, chosen, workspace.solution, ALBEDO_FILE)


def albedo_of_bigmaps(
    workspace: Workspace,
    work: AlbedoWork,
    executor: Executor,
    progress: Progress,
    *,
    wait: bool = False,
) -> AlbedoResult:
    """Solve the albedo of the fused bigmaps, and write ``bigmaps/albedo/SITE.MAP`` with it.

    Parameters
    ----------
    workspace : Workspace
    work : AlbedoWork
        Of bigmaps.
    executor : Executor
    progress : Progress
    wait : bool
        Whether to wait while another program works with the solution.

    Raises
    ------
    WorkspaceError
        If there are no bigmaps or images, another program works with the solution, or something
        cannot be read or written.
    InvalidValueError
        If the subset names no bigmap.
    """
    with locked(workspace.home / LOCK_FILE, wait=wait):
        surfaces = Surfaces.of_bigmaps(workspace).chosen(work.subset)
        sources = AlbedoSources.of(
            workspace, list(surfaces.grids.values()), _items(workspace, work), work
        )
        folder = workspace.home / _BIGMAPS
        make_folder(folder)
        found = dict(_solved(sources, surfaces, folder, executor, progress))
        bad = _bad_images(sources, surfaces, found)
        content = content_of(found, sources.work.as_json(), bad)
        content["made_from"] = sources.input_digests(surfaces.grids.values()) | {
            f"bigmaps/{name}.MAP": file_digest(surfaces.files[name]) for name in surfaces.grids
        }
        atomic.write_text(folder / ALBEDO_FILE, json_text(content))
    return AlbedoResult(workspace.solution, workspace.solution, folder, content)


def _bad_images(
    sources: AlbedoSources, surfaces: Surfaces, found: Mapping[str, Summary]
) -> list[dict[str, Any]]:
    """Return what is wrong with images that no surface could use."""
    fits = {name: one.images for name, one in found.items()}
    return list(image_findings(sources.use(surfaces.grids, fits)))


def _maplets(
    workspace: Workspace, work: AlbedoWork, executor: Executor, progress: Progress
) -> tuple[AlbedoSources, Surfaces]:
    """Return the chosen maplets, and the images of all."""
    del executor, progress
    whole = Surfaces.of_maplets(workspace)
    sources = AlbedoSources.of(workspace, list(whole.grids.values()), _items(workspace, work), work)
    return sources, whole.chosen(work.subset)


def _mapolas(
    workspace: Workspace, work: AlbedoWork, executor: Executor, progress: Progress
) -> tuple[AlbedoSources, Surfaces]:
    """Return the chosen mapolas as maplets where images show them, and the images of all."""
    check_registration(workspace, work.accepted)
    scene = Scene.of(workspace, light="none")
    grids = scene.mapola_grids
    chosen = work.subset.chosen(grids, {name: grid.center for name, grid in grids.items()})
    sources = AlbedoSources.of(workspace, list(grids.values()), _items(workspace, work), work)
    taken = {*workspace.maplet_names(), *workspace.landmark_names()}
    new = free_names(work.letters or free_letters(taken), taken)
    names = dict(zip(chosen, new, strict=False))
    placed = placed_mapolas(workspace, scene, sources, names, executor, progress)
    return sources, Surfaces.of_mapolas(placed)


def _items(workspace: Workspace, work: AlbedoWork) -> ItemStore:
    """Return where finished surfaces of a kind are kept."""
    place = item_folder(workspace.home, f"{_STEM}-{work.ground}")
    return ItemStore(place, whole_version(_VERSION))


def _solved(
    sources: AlbedoSources,
    surfaces: Surfaces,
    folder: Path,
    executor: Executor,
    progress: Progress,
) -> Iterator[tuple[str, Summary]]:
    """Solve the albedo of surfaces, write them, and yield their summaries."""
    names = list(surfaces.grids)
    sizes = [
        float(grid.size**2 * (1 + len(sources.images.showing(grid))))
        for grid in surfaces.grids.values()
    ]
    with progress.items("albedo from images", sizes, executor.workers) as task:
        grounds = map(surfaces.read, names)
        for name, (found, spent) in zip(
            names, executor.stream(Timed(sources.solve), grounds), strict=True
        ):
            # What no image shows keeps the albedo that it has.
            if found.outcome is not AlbedoOutcome.NO_IMAGE or name in surfaces.placed:
                surfaces.write(folder, name, found)
            task.advance_one(spent)
            yield name, summary_of(found, surfaces.read(name), surfaces.placed.get(name))
