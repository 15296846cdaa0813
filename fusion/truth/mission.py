"""The synthetic mission: an SPC working folder and lidar files of a known body."""

from __future__ import annotations

from functools import cache, partial
from pathlib import Path
from typing import Any

from fusion.runtime import Executor, Progress, ThreadExecutor
from fusion.runtime.machine import one_blas_thread
from fusion.truth.blind.body import truth_body
from fusion.truth.blind.delivery import write_blind
from fusion.truth.blind.settings import BlindSettings
from fusion.truth.generation import building, files_of, finished
from fusion.truth.ground import shadow_ground
from fusion.truth.images import write_images
from fusion.truth.planted import TRUTH_FILE, PlacedCenter, Planted, TrueState, write_truth
from fusion.truth.presets import MissionSettings
from fusion.truth.scans import day_biases, plan_observations, write_observations
from fusion.truth.size import check_room, mission_size
from fusion.truth.solution import light_of, plan_states, write_maplets, write_shape, write_states
from fusion.truth.work import Work
from spcola.camera import SpcImage
from spcola.truth.campaign import Pass, plan_passes
from spcola.truth.solid import SolidBody


@one_blas_thread()
def make_mission(
    folder: str | Path,
    *,
    settings: MissionSettings | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    replace: bool = False,
) -> Planted:
    """Write a synthetic mission into `folder` and return what was planted.

    ``spc/`` is an SPC working folder in the solution's frame. ``lidar/`` has one file for each
    scan in the reference frame (the body's own), ``images/`` the images as FITS. ``truth.json``
    has the planted values; it is written last and completes the mission. Existing files of the
    same mission are kept; the bytes depend neither on that nor on the number of workers.

    A blind mission has no ``spc/``: in addition to the scans it has raw ``images/``,
    ``calibration/`` frames, nominal ``kernels/`` and a coarse ``shape/``.

    Parameters
    ----------
    folder : path
        Created if missing.
    settings : MissionSettings, optional
        The preset mini by default.
    executor, progress : optional
        Where work is done, by default on one thread for each core, and progress reported.
    replace : bool
        Whether another mission in the folder may be removed.

    Raises
    ------
    WorkspaceError
        If something cannot be written, or the disk lacks room; if `folder` holds other things
        than a mission, or another one.
    """
    root = Path(folder)
    settings = settings or MissionSettings.mini()
    body = truth_body(settings)
    if (there := finished(root, settings, body.fingerprint)) is not None:
        return there
    check_room(root, mission_size(settings))
    with building(root, settings, body.fingerprint, replace=replace) as site:
        work = Work(settings, site, body, executor or ThreadExecutor(), progress or Progress())
        passes = plan_passes(settings.passes, work.random("passes"))
        observations = plan_observations(passes, settings)
        days = day_biases(observations, settings)
        scans = write_observations(work, observations, days)
        centers, images, blind = _write_rest(work, passes)
        files = files_of(root)
        planted = Planted(settings, scans, days, centers, images, files, body.fingerprint, blind)
        write_truth(root / TRUTH_FILE, planted)
    return planted


def _write_rest(
    work: Work, passes: list[Pass]
) -> tuple[dict[str, PlacedCenter], dict[str, TrueState], dict[str, Any]]:
    """Write all but the scans; return true centres and states by name, and what else is planted."""
    settings, body = work.settings, work.body
    if isinstance(settings, BlindSettings) and isinstance(body, SolidBody):
        found, planted = write_blind(work, settings, body)
        return {}, {name: _true_state(image.truth) for name, image in found.items()}, planted
    return *_write_solution(work, passes), {}


def _write_solution(
    work: Work, passes: list[Pass]
) -> tuple[dict[str, PlacedCenter], dict[str, TrueState]]:
    """Write the SPC solution, and the images if wanted; return true centres and states by name.

    Without a solution only the shape is written.
    """
    if not work.settings.spc:
        write_shape(work)
        return {}, {}
    shadows = shadow_ground(work.settings.body)
    light = cache(partial(light_of, work.settings, shadows))
    write_shape(work, light)
    centers = write_maplets(work, light)
    states = plan_states(work, passes)
    write_states(work, states, centers, shadows)
    if work.settings.images:
        write_images(work, states)
    images = {state.truth.name: _true_state(state.truth) for state in states}
    return {center.name: center for center in centers}, images


def _true_state(truth: SpcImage) -> TrueState:
    axes = tuple(tuple(axis) for axis in truth.axes.tolist())
    return TrueState(tuple(truth.position.tolist()), axes)
