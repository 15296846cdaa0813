""".SUM and .NOM of images from kernels or a table, and their difference from the solution."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fusion.runtime.folders import LOCK_FILE, clear_abandoned_folders, locked, make_folder
from fusion.stages.states.source import (
    SourceOptions,
    SpiceSource,
    spice_source,
    stated_spin,
)
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.camera.linescan import LineScanImage
from spcola.errors import InvalidValueError, WorkspaceError
from spcola.formats.images.names import NamedImage, spc_names
from spcola.formats.solution import (
    read_list,
    write_list,
    write_nominal,
    write_summary,
)
from spcola.formats.solution.any_camera import read_camera
from spcola.formats.solution.exact_camera import camera_files
from spcola.formats.solution.line_scan import write_line_scan
from spcola.formats.states import Exposure, read_poses
from spcola.navigation import NominalState, et_from_utc
from spcola.navigation.states import (
    ImageState,
    StateDifference,
    StateSource,
    compare_states,
)
from spcola.spice.states import SpiceCamera, body_rate, clock_time, spice_states

_PICTURES = "PICTLIST.TXT"
# Without a .SUM file all brightnesses of 16 bits are used.
_BRIGHTEST = 65535


@dataclass(frozen=True)
class NominalOptions:
    """The camera and the uncertainties of new images.

    Parameters
    ----------
    camera : Path
        A .SUM file, whose thresholds are used too, or a camera file with one camera.
    position_sigma_m : float, optional
        Of V0, each axis, metres; that of the state if not given.
    pointing_sigma : float, optional
        Of each rotation, radians; that of the state if not given.
    """

    camera: Path
    position_sigma_m: float | None = None
    pointing_sigma: float | None = None

    def applied(self, state: ImageState) -> ImageState:
        """Return a state with these uncertainties."""
        one, two = self.position_sigma_m, self.pointing_sigma
        return replace(
            state,
            scobj_sigma=state.scobj_sigma if one is None else np.full(3, one),
            pointing_sigma=state.pointing_sigma if two is None else np.full(3, two),
        )


@dataclass(frozen=True, eq=False)
class FoundStates:
    """States of images from one source.

    Parameters
    ----------
    states : tuple of ImageState
    body_rates : (N, 3) ndarray, optional
        Angular velocity of the body at each, body-fixed, rad/s; with it the nominal velocity is
        known.
    filters : tuple of str or None
        Filter of each; empty if unknown.
    originals : tuple of str
        Names before SPC's rule gave others; empty if it did not.
    """

    states: tuple[ImageState, ...]
    body_rates: FloatArray | None = None
    filters: tuple[str | None, ...] = ()
    originals: tuple[str, ...] = ()

    def named(self, camera: str) -> FoundStates:
        """Return the states with SPC's names of twelve characters.

        Parameters
        ----------
        camera : str
            The first character.

        Raises
        ------
        InvalidValueError
            If a state has no time, or two images get one name.
        """
        filters = self.filters or (None,) * len(self.states)
        images = [
            NamedImage(state.name, state.time, kind)
            for state, kind in zip(self.states, filters, strict=True)
        ]
        names = spc_names(camera, images)
        renamed = [
            replace(state, name=name) for state, name in zip(self.states, names, strict=True)
        ]
        return replace(self, states=tuple(renamed), originals=tuple(names.values()))


def states_by_kernels(
    workspace: Workspace,
    exposures: Sequence[Exposure] | None,
    options: SourceOptions,
    camera: SpiceCamera,
) -> FoundStates:
    """Return the states of exposures by kernels.

    Parameters
    ----------
    workspace : Workspace
        Its [spice] states what the options do not.
    exposures : sequence of Exposure, optional
        Those of the images of the workspace if not given.
    options : SourceOptions
    camera : SpiceCamera
        Its spacecraft and body are replaced by those of options and settings.

    Raises
    ------
    SettingsError
        If there are no kernels, or spacecraft or body are not stated.
    KernelError
        If the kernels do not cover an exposure, or disagree about the rotation.
    WorkspaceError
        If there is no image.
    """
    wanted = _solved(workspace) if exposures is None else exposures
    source = spice_source(workspace, workspace.settings(), options, camera)
    with source.kernels.load():
        names = [exposure.name for exposure in wanted]
        times = [_middle(exposure, source) for exposure in wanted]
        rates = [body_rate(source.camera.body, time) for time in times]
        states = tuple(spice_states(source.camera, names, times))
    filters = tuple(exposure.filter for exposure in wanted)
    return FoundStates(states, np.array(rates).reshape(-1, 3), filters)


def states_by_poses(
    workspace: Workspace,
    path: Path,
    *,
    columns: Mapping[str, str],
    pck: Path | None = None,
    body: int = 0,
) -> FoundStates:
    """Return the states in a table of poses.

    Parameters
    ----------
    workspace : Workspace
    path : Path
    columns : mapping of str to str
        As of :func:`spcola.formats.states.read_poses`.
    pck : Path, optional
        PCK with the rotation for vectors along J2000; else it is that of [spin].
    body : int
        NAIF number of the body in it; 0: that of [spice].

    Raises
    ------
    FormatError
        If the table cannot be read, or is along J2000 and no rotation is stated.
    KernelError
        If the PCK does not state the rotation.
    """
    spin = stated_spin(workspace, pck, body)
    return FoundStates(tuple(read_poses(path, columns=columns, spin=spin)))


def make_sumfiles(
    workspace: Workspace, found: FoundStates, options: NominalOptions, *, wait: bool = False
) -> list[ImageState]:
    """Write the .SUM files of new images, and .NOM files where the velocity is known.

    Existing files are never replaced; a list of images is continued.

    Parameters
    ----------
    workspace : Workspace
    found : FoundStates
    options : NominalOptions
    wait : bool
        Whether to wait while another program works with the solution.

    Returns
    -------
    list of ImageState

    Raises
    ------
    WorkspaceError
        If there is a file of one of the images, a file cannot be written, or another program works
        with the solution.
    InvalidValueError
        If a name is too long for SPC, or a state has no time or no direction to the Sun.
    """
    states = [options.applied(state) for state in found.states]
    camera, thresholds = read_camera(options.camera)
    nominal: list[NominalState] = []
    if found.body_rates is not None:
        pairs = zip(states, found.body_rates, strict=True)
        nominal = [state.as_nominal(rate) for state, rate in pairs]
    with locked(workspace.home / LOCK_FILE, wait=wait):
        for state in states:
            _check_new(workspace, state)
        seen = thresholds or (0, _BRIGHTEST)
        images = [state.as_image(camera, thresholds=seen) for state in states]
        write_states(workspace, images, nominal)
    return states


def compare_with_solution(workspace: Workspace, found: FoundStates) -> list[StateDifference]:
    """Return states less those in the .SUM files of the images.

    Raises
    ------
    WorkspaceError
        If an image has no .SUM file.
    """
    pairs = [(state, workspace.image(state.name)) for state in found.states]
    return [
        compare_states(state, ImageState.of_image(image), image.camera) for state, image in pairs
    ]


def write_states(
    workspace: Workspace,
    images: Sequence[SpcImage],
    nominal: Sequence[NominalState] = (),
    scans: Sequence[LineScanImage] = (),
) -> None:
    """Write states into the locked solution of a workspace; a list of images is continued.

    .SUM and .NOM files, and the files of line scans, which SPC's list does not have.

    Parameters
    ----------
    workspace : Workspace
    images : sequence of SpcImage
    nominal : sequence of NominalState
    scans : sequence of LineScanImage

    Raises
    ------
    InvalidValueError
        If a name is too long for SPC.
    WorkspaceError
        If there is a file of an image with other content, or a file cannot be written; then none
        is.
    """
    _write(workspace, images, nominal, scans)
    # A list that is not there means all images, and remains so.
    path = workspace.home / _PICTURES
    if path.is_file():
        write_list(path, dict.fromkeys([*read_list(path), *(image.name for image in images)]))


def _solved(workspace: Workspace) -> list[Exposure]:
    """Return the exposures of a workspace's images."""
    images = workspace.images()
    if not images:
        raise WorkspaceError("holds no image", workspace.root / "SUMFILES", "import a solution")
    return [Exposure(image.name, et_from_utc(image.utc)) for image in images]


def _middle(exposure: Exposure, source: SpiceSource) -> float:
    """Return the middle of an exposure, ephemeris time, s; the kernels are loaded."""
    start = exposure.time
    if start is None:
        start = clock_time(source.camera.spacecraft, exposure.clock)
    return start + exposure.delay_s


def _check_new(workspace: Workspace, state: ImageState) -> None:
    """Refuse a state whose files are there, or without the Sun, which a .SUM file needs."""
    for path in _paths(workspace, state.name):
        if path.exists():
            raise WorkspaceError(
                "is there already", path, "leave its image out of the table, or move the file"
            )
    if not np.isfinite(state.sun).all():
        what, do = {
            StateSource.SPICE: ("the kernels do not give the Sun", "add an SPK with it"),
        }.get(state.source, ("has no direction to the Sun", "add columns sunx, suny, sunz"))
        raise InvalidValueError(what, state.name, do)


def _write(
    workspace: Workspace,
    images: Sequence[SpcImage],
    nominal: Sequence[NominalState],
    scans: Sequence[LineScanImage],
) -> None:
    """Write the files of all images; none, if one of them cannot be written."""
    clear_abandoned_folders(workspace.home / "sumfiles")
    folder = workspace.home / f".sumfiles.{os.getpid()}"
    make_folder(folder)
    try:
        made = []
        for image in images:
            target = _paths(workspace, image.name)[0]
            made.append((folder / target.name, target))
            with _at(target):
                write_summary(made[-1][0], image)
        for state in nominal:
            target = _paths(workspace, state.name)[1]
            made.append((folder / target.name, target))
            with _at(target):
                write_nominal(made[-1][0], state)
        for scan in scans:
            target = workspace.line_scan_path(scan.name)
            made.append((folder / target.name, target))
            with _at(target):
                write_line_scan(made[-1][0], scan)
        for path, target in made:
            _check_same(path, target)
        # Named by their content: one that is there is the same, unless it is damaged.
        cameras = [(path, workspace.home / "SUMFILES" / path.name) for path in camera_files(folder)]
        for path, target in [*cameras, *made]:
            make_folder(target.parent)
            path.replace(target)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _check_same(path: Path, target: Path) -> None:
    """Refuse a file that is there with other content; an interrupted command left the same."""
    if target.exists() and target.read_bytes() != path.read_bytes():
        raise WorkspaceError(
            "is there already, with another state", target, "move it, or leave its image out"
        )


@contextmanager
def _at(target: Path) -> Iterator[None]:
    """Name the file to be written in errors, not its temporary place."""
    try:
        yield
    except InvalidValueError as error:
        raise InvalidValueError(error.what, target, error.do) from error


def _paths(workspace: Workspace, name: str) -> tuple[Path, Path]:
    """Return where the .SUM and the .NOM file of an image lie."""
    return workspace.image_path(name), workspace.home / "NOMINALS" / f"{name}.NOM"
