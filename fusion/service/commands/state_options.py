"""Options of commands that read states of images: kernels, tables, cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import typer

from fusion.service.commands.fields import NAIF_NUMBERS, Mark, each_between, named_columns

if TYPE_CHECKING:
    from fusion.stages.states import FoundStates, NominalOptions, SourceOptions
    from fusion.workspace import Workspace
    from spcola.formats.states import Exposure
    from spcola.spice.states import SpiceCamera

LetterOption = Annotated[
    str,
    typer.Option(
        metavar="C",
        help="Name the images by SPC's rule: this character, the time, the filter. By default the "
        "name as stated, or that of the file, where it has up to 12 characters.",
    ),
]
CameraOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="The camera: a camera file (spcola camera convert), or a .SUM file, whose "
        "thresholds are used too. ISD and COLMAP have cameras of their own.",
    ),
]


@dataclass(frozen=True)
class BodyOptions:
    """Options that name spacecraft and body."""

    panel: ClassVar[str] = "Spacecraft and body"
    spacecraft: Annotated[
        str,
        typer.Option(
            metavar="NAME|NUMBER", help="The spacecraft; if not given, that of [spice] spacecraft."
        ),
    ] = ""
    body: Annotated[
        int,
        typer.Option(
            metavar="NUMBER", **NAIF_NUMBERS, help="NAIF number of the body; else [spice] body."
        ),
    ] = 0


@dataclass(frozen=True)
class StateOptions:
    """Options that choose kernels and a camera in them."""

    panel: ClassVar[str] = "States by SPICE kernels"
    frame: Annotated[
        str, typer.Option(metavar="FRAME", help="Frame of the camera in the kernels.")
    ] = ""
    correction: Annotated[
        Literal["none", "light-time", "light-time+aberration"],
        typer.Option(help="What is applied to the direction of the body."),
    ] = "light-time+aberration"
    pupil_m: Annotated[
        tuple[float, float, float],
        typer.Option(
            metavar="X Y Z",
            callback=each_between(-1e4, 1e4),
            help="From the spacecraft's centre of mass to the pupil, metres, along the axes of "
            "the camera's frame.",
        ),
    ] = (0.0, 0.0, 0.0)
    kernel: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="A kernel or meta-kernel; repeat it. If not given: [spice] kernels.",
        ),
    ] = None
    prime_meridian: Annotated[
        str,
        typer.Option(
            metavar="FILE", help="Which kernel gives the body's rotation, if several state it."
        ),
    ] = ""

    def states(
        self, workspace: Workspace, exposures: list[Exposure] | None, body: BodyOptions
    ) -> FoundStates:
        """Return the states of exposures, or of the images of the workspace, by the kernels."""
        from fusion.stages.states import states_by_kernels

        return states_by_kernels(workspace, exposures, self.source(body), self.spice_camera())

    def source(self, body: BodyOptions) -> SourceOptions:
        """Return the kernels, spacecraft and body that are named."""
        from fusion.stages.states import SourceOptions

        return SourceOptions(
            tuple(self.kernel or ()), self.prime_meridian, body.spacecraft, body.body
        )

    def spice_camera(self) -> SpiceCamera:
        """Return the camera in the kernels, without spacecraft and body."""
        from numpy import array

        from spcola.spice.states import Correction, SpiceCamera

        return SpiceCamera("", 0, self.frame, Correction(self.correction), array(self.pupil_m))


@dataclass(frozen=True)
class PoseOptions:
    """Options that name a table of poses."""

    panel: ClassVar[str] = "States of a table"
    poses: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Take the states from this table (CSV) instead of kernels: columns image, utc, "
            "v0x_km, ... or scx_km, ..., cxx, ... or qw, ... or ra_deg, dec_deg, twist_deg, and "
            "sunx, ...; names ending in _j2000 are inertial.",
        ),
    ] = None
    columns: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=COLUMN",
            help="The table's column of such a name, as in 'scx_m=X [m]'; repeat it.",
        ),
        Mark.COLUMNS,
    ] = None
    pck: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="PCK with the rotation for inertial columns and labels; else that of [spin].",
        ),
    ] = None

    def states(self, workspace: Workspace, body: BodyOptions) -> FoundStates:
        """Return the states in the table."""
        from fusion.stages.states import states_by_poses

        assert self.poses is not None
        return states_by_poses(
            workspace, self.poses, columns=self.renamed(), pck=self.pck, body=body.body
        )

    def renamed(self) -> dict[str, str]:
        """Return the names of columns by what they are called in the table."""
        return named_columns(self.columns or (), "NAME=COLUMN")


@dataclass(frozen=True)
class GivenStates:
    """Options that name the sources of states which several commands read."""

    kernels: StateOptions = StateOptions()
    table: PoseOptions = PoseOptions()
    names: BodyOptions = BodyOptions()

    def states(self, workspace: Workspace, exposures: list[Exposure] | None) -> FoundStates:
        """Return the states in the table, or of exposures by the kernels."""
        if self.table.poses is not None:
            return self.table.states(workspace, self.names)
        return self.kernels.states(workspace, exposures, self.names)


@dataclass(frozen=True)
class NewSumOptions:
    """Options of new .SUM files."""

    panel: ClassVar[str] = "New .SUM files"
    camera: CameraOption = None
    letter: LetterOption = ""
    sigma_m: Annotated[
        float | None,
        typer.Option(
            "--sigma-m", metavar="M", min=1e-6, max=1e9, help="Sigma of V0; unknown if not given."
        ),
    ] = None
    sigma_mrad: Annotated[
        float | None,
        typer.Option(
            "--sigma-mrad",
            metavar="MRAD",
            min=1e-9,
            max=1e4,
            help="Sigma of the pointing, each axis.",
        ),
    ] = None

    def nominal(self) -> NominalOptions:
        """Return camera and sigmas."""
        from fusion.stages.states import NominalOptions

        assert self.camera is not None
        pointing = None if self.sigma_mrad is None else 1e-3 * self.sigma_mrad
        return NominalOptions(self.camera, self.sigma_m, pointing)
