""".SUM and .NOM of images from SPICE kernels, and the difference of kernels and solution."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fusion.runtime.folders import make_folder
from fusion.stages.states.source import SpiceSource
from fusion.workspace import Workspace
from spcola.camera import SpcImage
from spcola.errors import KernelError, WorkspaceError
from spcola.formats.solution import (
    read_list,
    read_summary,
    write_list,
    write_nominal,
    write_summary,
)
from spcola.formats.states import Exposure
from spcola.navigation import NominalState
from spcola.navigation.states import (
    ImageState,
    StateDifference,
    compare_states,
)
from spcola.spice.states import body_rate, clock_time, spice_states

_PICTURES = "PICTLIST.TXT"


@dataclass(frozen=True)
class NominalOptions:
    """The camera and the uncertainties of new images.

    Parameters
    ----------
    like : Path
        A .SUM file with the camera and the thresholds of the images.
    position_sigma_m : float
        Of V0, each axis, metres; NaN: unknown.
    pointing_sigma : float
        Of each rotation, radians; NaN: unknown.
    """

    like: Path
    position_sigma_m: float = float("nan")
    pointing_sigma: float = float("nan")


def make_sumfiles(
    workspace: Workspace,
    exposures: Sequence[Exposure],
    source: SpiceSource,
    options: NominalOptions,
) -> list[ImageState]:
    """Write .SUM and .NOM files of new images; existing ones are never replaced.

    Parameters
    ----------
    workspace : Workspace
    exposures : sequence of Exposure
    source : SpiceSource
    options : NominalOptions

    Returns
    -------
    list of ImageState

    Raises
    ------
    KernelError
        If the kernels do not cover an exposure.
    WorkspaceError
        If there is a file of one of the images, or a file cannot be written.
    InvalidValueError
        If a name is too long for SPC, or the kernels do not give the Sun.
    """
    for exposure in exposures:
        for path in _paths(workspace, exposure.name):
            if path.exists():
                raise WorkspaceError(
                    "is there already", path, "leave its image out of the table, or move the file"
                )
    example = read_summary(options.like)
    with source.kernels.load():
        names = [exposure.name for exposure in exposures]
        times = [_middle(exposure, source) for exposure in exposures]
        states = [
            replace(
                state,
                scobj_sigma=np.full(3, options.position_sigma_m),
                pointing_sigma=np.full(3, options.pointing_sigma),
            )
            for state in spice_states(source.camera, names, times)
        ]
        rates = [body_rate(source.camera.body, time) for time in times]
    _check_sun(states)
    images = [state.as_image(example.camera, thresholds=example.thresholds) for state in states]
    nominal = [state.as_nominal(rate) for state, rate in zip(states, rates, strict=True)]
    _write(workspace, images, nominal)
    _list(workspace, names)
    return states


def compare_with_kernels(workspace: Workspace, source: SpiceSource) -> list[StateDifference]:
    """Return the states of a workspace's images by kernels less those in their .SUM files.

    Raises
    ------
    KernelError
        If the kernels do not cover an image.
    WorkspaceError
        If there is no image.
    """
    images = workspace.images()
    if not images:
        raise WorkspaceError("holds no image", workspace.root / "SUMFILES", "import a solution")
    solved = [ImageState.of_image(image) for image in images]
    with source.kernels.load():
        found = spice_states(
            source.camera, [state.name for state in solved], [state.time for state in solved]
        )
    return [
        compare_states(one, two, image.camera)
        for one, two, image in zip(found, solved, images, strict=True)
    ]


def _middle(exposure: Exposure, source: SpiceSource) -> float:
    """Return the middle of an exposure, ephemeris time, s; the kernels are loaded."""
    start = exposure.time
    if start is None:
        start = clock_time(source.camera.spacecraft, exposure.clock)
    return start + exposure.delay_s


def _check_sun(states: Sequence[ImageState]) -> None:
    """Refuse states without the direction to the Sun, which a .SUM file needs."""
    for state in states:
        if not np.isfinite(state.sun).all():
            raise KernelError(
                "the kernels do not give the position of the Sun", state.name, "add an SPK with it"
            )


def _write(
    workspace: Workspace, images: Sequence[SpcImage], nominal: Sequence[NominalState]
) -> None:
    """Write the files of all images; none, if one of them cannot be written."""
    with tempfile.TemporaryDirectory(prefix=".sumfiles-", dir=workspace.root) as folder:
        made = []
        for image, before in zip(images, nominal, strict=True):
            targets = _paths(workspace, image.name)
            summary, other = (Path(folder) / path.name for path in targets)
            write_nominal(other, before)
            write_summary(summary, image)
            made += list(zip((summary, other), targets, strict=True))
        for path, target in made:
            make_folder(target.parent)
            path.replace(target)


def _paths(workspace: Workspace, name: str) -> tuple[Path, Path]:
    """Return where the .SUM and the .NOM file of an image lie."""
    return workspace.image_path(name), workspace.root / "NOMINALS" / f"{name}.NOM"


def _list(workspace: Workspace, names: Sequence[str]) -> None:
    """Append images to the list of images, where there is one."""
    path = workspace.root / _PICTURES
    if path.is_file():
        write_list(path, dict.fromkeys([*read_list(path), *names]))
