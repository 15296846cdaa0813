"""Options of ``spcola images``: pixels, states and cameras."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import typer

from fusion.service.commands.fields import Mark, each_between
from fusion.service.commands.state_options import CameraOption, GivenStates, LetterOption

if TYPE_CHECKING:
    from fusion.stages.images import Recipe, StateChoice
    from spcola.camera.detector import SmearTimes

_Orientation = Literal[
    "as-stored", "mirrored-samples", "mirrored-lines", "half-turn", "transposed",
    "quarter-turn-right", "quarter-turn-left", "anti-transposed",
]  # fmt: skip


@dataclass(frozen=True)
class SmearOptions:
    """Options of the smear of a frame transfer."""

    panel: ClassVar[str] = "Smear of a frame transfer"
    smear_s: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            min=0.0,
            max=1e3,
            help="Remove the smear of a detector without a shutter whose frame is moved into the "
            "memory: time for one line, seconds. By default that of frame_transfer in the camera "
            "file, if it has it; 0: leave the smear.",
        ),
    ] = None
    clearing_s: Annotated[
        float | None,
        typer.Option(
            metavar="S", min=0.0, max=1e3,
            help="Time for one line of the transfer that clears the frame before the exposure, if "
            "it is cleared so.",
        ),
    ] = None  # fmt: skip
    memory: Annotated[
        Literal["first-line", "last-line"] | None,
        typer.Option(help="Edge of the image, as stored, at which the frame enters the memory; "
                     "first-line if neither this nor the camera file states it."),
    ] = None  # fmt: skip
    exposure_s: Annotated[
        float | None,
        typer.Option(
            metavar="S", min=1e-9, max=1e6,
            help="Exposure time of all images; by default that of each label.",
        ),
    ] = None  # fmt: skip

    def times(self, stated: SmearTimes | None) -> SmearTimes | None:
        """Return the times of the transfer: the options', else those that the camera states."""
        from spcola.camera.detector import SmearTimes

        line_s = self.smear_s
        if line_s is None and stated is not None:
            line_s = stated.line_transfer_s
        if not line_s:
            if line_s is None and any((self.clearing_s, self.exposure_s, self.memory)):
                raise typer.BadParameter(
                    "is needed with the other options of smear, or a camera file with "
                    "frame_transfer",
                    param_hint="--smear-s",
                )
            return None
        other = stated or SmearTimes(line_s)
        clearing = other.clearing_s if self.clearing_s is None else self.clearing_s
        side: Any = (self.memory or other.memory_side).replace("-", " ")
        return SmearTimes(line_s, clearing, side, self.exposure_s)


@dataclass(frozen=True)
class PixelOptions:
    """Options of what is done to pixels."""

    panel: ClassVar[str] = "Pixels"
    dark: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Dark frame, subtracted from each image.")
    ] = None
    dark_scale: Annotated[
        float,
        typer.Option(min=1e-6, max=1e6, help="Exposure time of the images over the dark frame's."),
    ] = 1.0
    flat: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Flat field; each image is divided by it.")
    ] = None
    bits: Annotated[
        int | None,
        typer.Option(metavar="8|16", min=8, max=16,
                     help="Bits of a pixel in the .DAT files; by default those of "
                     "the file, 16 for more than 8."),
    ] = None  # fmt: skip
    gamma: Annotated[
        float,
        typer.Option(
            min=0.1, max=10.0,
            help="Brightness is the number in the file to this power: 2 of square-root encoding, "
            "about 2.2 of pictures made for screens, 1 where both are proportional.",
        ),
    ] = 1.0  # fmt: skip
    low: Annotated[
        int | None,
        typer.Option(
            metavar="DN", min=0, max=65535,
            help="Lowest brightness of lit ground; by default found in each image's histogram.",
        ),
    ] = None  # fmt: skip
    high: Annotated[
        int | None,
        typer.Option(
            metavar="DN", min=1, max=65535,
            help="Highest brightness that is used; by default all below saturation.",
        ),
    ] = None  # fmt: skip
    bright_background: Annotated[
        bool,
        typer.Option(
            "--bright-background",
            help="The body lies in front of something brighter, such as a planet: find the highest "
            "brightness of the body in each image's histogram.",
        ),
    ] = False
    orientation: Annotated[
        _Orientation,
        typer.Option(help="How the pixels of the files are turned or mirrored before they are "
                     "written; --report finds it where there are states and a shape."),
    ] = "as-stored"  # fmt: skip
    size: Annotated[
        tuple[int, int] | None,
        typer.Option(metavar="SAMPLES LINES", callback=each_between(1, 200_000),
                     help="Size of .DAT files: they have no header."),
    ] = None  # fmt: skip
    smear: SmearOptions = SmearOptions()

    def recipe(self, camera: Path | None) -> Recipe:
        """Return what is done to the pixels; `camera` is the camera file."""
        from fusion.stages.images import Recipe, Turn
        from spcola.formats.solution.any_camera import read_one_instrument

        self.check()
        bits: Any = self.bits
        stated = None if camera is None else read_one_instrument(camera)[0].smear
        return Recipe(
            self.dark, self.flat, self.dark_scale, bits, Turn(self.orientation),
            self.smear.times(stated), self.low, self.high, self.bright_background, self.gamma,
        )  # fmt: skip

    def check(self) -> None:
        """Refuse options that contradict each other.

        Raises
        ------
        typer.BadParameter
        """
        if self.bits not in (None, 8, 16):
            raise typer.BadParameter("is 8 or 16", param_hint="--bits")
        if self.high is not None and self.bright_background:
            raise typer.BadParameter("finds what --high gives", param_hint="--bright-background")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise typer.BadParameter("must be below --high", param_hint="--low")


@dataclass(frozen=True)
class NameOptions:
    """Options of names, and which images come in."""

    panel: ClassVar[str] = "Names and choice"
    letter: LetterOption = ""
    filter: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only images of this filter; repeat it for several."),
    ] = None


@dataclass(frozen=True)
class ReportOptions:
    """Options of the report."""

    panel: ClassVar[str] = "Report"
    report: Annotated[
        bool,
        typer.Option(
            "--report",
            help="Look at all images of the workspace: what they show, range, resolution, phase, "
            "emission, and whether they fit the shape at their states, in which orientation and "
            "with which offset; where they do not, what is likely wrong. Writes images.html.",
        ),
    ] = False
    thumbnails: Annotated[
        bool, typer.Option("--thumbnails", help="With --report: small pictures on the page.")
    ] = False


@dataclass(frozen=True)
class ImageStateOptions:
    """Options that choose states and cameras."""

    panel: ClassVar[str] = "States and cameras"
    states: Annotated[
        Literal["spice", "label", "isd", "colmap"] | None,
        typer.Option(
            help="Source of the states if it is no table (--poses): SPICE kernels at the labels' "
            "times, labels (tables in ISIS cubes, geometry of PDS3 and PDS4), ISD files named as "
            "the images, or a COLMAP model. Without a source only pixels come in."
        ),
    ] = None
    camera: CameraOption = None
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Folder of the COLMAP model, or of the ISD files if they are not "
            "next to the images.",
        ),
        Mark.FOLDER,
    ] = None  # fmt: skip
    model_unit: Annotated[Literal["km", "m"], typer.Option(help="Unit of the COLMAP model.")] = "km"
    first_pixel: Annotated[
        float,
        typer.Option(min=0.0, max=1.0, help="COLMAP: coordinate of the first pixel's centre."),
    ] = 0.5
    times: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Times and directions to the Sun where states have none (CSV): image, utc, and "
            "sunx ... or subsolar_lat_deg, subsolar_lon_deg.",
        ),
    ] = None

    given: GivenStates = field(default_factory=GivenStates)

    def choice(self) -> StateChoice:
        """Return the source of states."""
        from fusion.stages.images import StateChoice, StateKind

        poses, kernels, body = self.given.table, self.given.kernels, self.given.names
        if poses.poses is not None and self.states is not None:
            raise typer.BadParameter("give --poses or --states, not both", param_hint="--states")
        if self.states == "colmap" and self.model is None:
            raise typer.BadParameter("is needed with --states colmap", param_hint="--model")
        if self.states == "spice" and not kernels.frame:
            raise typer.BadParameter("is needed with --states spice", param_hint="--frame")
        kind = StateKind.POSES if poses.poses is not None else StateKind(self.states or "")
        chosen = StateChoice(
            kind, poses.poses or self.model, self.camera, self.times,
            unit=self.model_unit, first_pixel=self.first_pixel,
        )  # fmt: skip
        if kind in (StateKind.POSES, StateKind.LABEL):
            return replace(chosen, columns=poses.renamed(), pck=poses.pck,
                           kernels=kernels.source(body))  # fmt: skip
        if kind is StateKind.SPICE:
            return replace(chosen, kernels=kernels.source(body), frame=kernels.spice_camera())
        return chosen
