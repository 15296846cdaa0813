"""What ``spcola camera convert`` does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusion.service.commands.fields import NAIF_NUMBERS, Mark, each_between
from fusion.service.commands.site import Done, Site
from fusion.service.commands.states import check_kernels
from spcola.errors import SettingsError

if TYPE_CHECKING:
    from spcola.camera.instrument import Instrument

__all__ = ["ConvertOptions", "convert_cameras"]
_ISD = (".isd", ".json")


@dataclass(frozen=True)
class SourceOptions:
    """What the files do not state, by their format."""

    number: Annotated[
        int | None,
        typer.Option(metavar="N", **NAIF_NUMBERS, help="Kernels: NAIF number, such as -64361."),
    ] = None
    variant: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            **NAIF_NUMBERS,
            help="Kernels: number of a filter or focus position that comes first.",
        ),
    ] = None
    filter: Annotated[
        str, typer.Option(metavar="NAME", help="Kernels: suffix of a filter's keywords, as PAN.")
    ] = ""
    first_pixel: Annotated[
        int,
        typer.Option(min=0, max=1, help="Kernels: what BORESIGHT_SAMPLE calls the first pixel."),
    ] = 1
    size: Annotated[
        tuple[int, int] | None,
        typer.Option(
            metavar="SAMPLES LINES",
            callback=each_between(1, 200_000),
            help="Kernels: size, if they do not state it.",
        ),
    ] = None
    optical_axis: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="PIXEL LINE",
            callback=each_between(-1e6, 1e6),
            help="ISD: optical axis, if it is not stated.",
        ),
    ] = None
    summing: Annotated[
        float | None,
        typer.Option(min=1e-3, max=1e3, help="ISD: detector pixels in a pixel, if it is wrong."),
    ] = None
    pixel_mm: Annotated[
        float, typer.Option(min=1e-6, max=10.0, help="COLMAP: size of a pixel, millimetres.")
    ] = 0.01

    def read(self, files: list[Path]) -> list[Instrument]:
        """Return the instruments of files of one format.

        Raises
        ------
        SettingsError
            If the format is not known, or a kernel has no number of an instrument.
        """
        from spcola.camera.instrument import Instrument
        from spcola.formats.cameras import read_cameras, read_colmap_cameras, read_isd
        from spcola.spice.instruments import read_instrument_kernels

        first = files[0]
        ending = first.suffix.lower()
        if self.number is not None:
            return [
                read_instrument_kernels(
                    files,
                    self.number,
                    variant=self.variant,
                    filter=self.filter,
                    first_pixel=self.first_pixel,
                    size=self.size,
                )
            ]
        if len(files) > 1 or ending == ".ti":
            raise SettingsError(
                "kernels have many instruments", first, "give --number, such as -64361"
            )
        if ending == ".toml":
            return list(read_cameras(first).values())
        if ending == ".bin":
            cameras = read_colmap_cameras(first, pixel_mm=self.pixel_mm)
            return [Instrument(str(key), camera) for key, camera in cameras.items()]
        if ending in _ISD:
            sensor = read_isd(first, optical_axis=self.optical_axis, summing=self.summing)
            return [Instrument(first.stem, sensor.camera)]
        raise SettingsError(
            "is none of .ti, .isd, .json, .bin, .toml", first, "name it by its format"
        )


@dataclass(frozen=True)
class MomentOptions:
    """When the camera is as it is written."""

    temperature_c: Annotated[
        float | None,
        typer.Option(
            "--temperature",
            metavar="C",
            min=-273.15,
            max=1e4,
            help="Write the camera at this temperature.",
        ),
    ] = None
    range_m: Annotated[
        float | None,
        typer.Option(
            "--range",
            metavar="M",
            min=1e-3,
            max=1e15,
            help="Write the camera focused at this range.",
        ),
    ] = None
    motor: Annotated[
        float | None,
        typer.Option(
            metavar="P", min=-1e6, max=1e6, help="Write the camera at this position of its focus."
        ),
    ] = None

    def at(self, found: list[Instrument]) -> tuple[list[Instrument], dict[str, list[str]]]:
        """Return the cameras as they are then, without their laws, and what was assumed of each."""
        if self.temperature_c is self.range_m is self.motor is None:
            return found, {}
        shots = [
            one.at(temperature_c=self.temperature_c, range_m=self.range_m, motor=self.motor)
            for one in found
        ]
        pairs = list(zip(found, shots, strict=True))
        then = [
            replace(one, camera=shot.camera, temperature=None, focus=None) for one, shot in pairs
        ]
        return then, {one.name: [why.value for why in shot.assumed] for one, shot in pairs}


@dataclass(frozen=True)
class ConvertOptions:
    """Options of ``spcola camera convert``."""

    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="Instrument kernels and addenda in their order of loading (with --number); or "
            "one ISD (.isd, .json), COLMAP model (cameras.bin) or camera file (.toml).",
        ),
    ]
    out: Annotated[
        Path,
        typer.Option("-o", "--out", metavar="FILE", help="Camera file to write (TOML)."),
        Mark.OUTPUT,
    ]
    source: SourceOptions = SourceOptions()
    name: Annotated[
        str, typer.Option(metavar="NAME", help="Name of the camera, if there is only one.")
    ] = ""
    moment: MomentOptions = MomentOptions()


def convert_cameras(site: Site, given: ConvertOptions) -> Done:
    """Write cameras of other formats as a camera file."""
    from spcola.formats.cameras import write_cameras

    files, out = given.files, given.out
    check_kernels(site, [path for path in files if path.suffix.lower() == ".tm"])
    found = given.source.read(files)
    if given.name:
        found = [_renamed(found, given.name)]
    found, assumed = given.moment.at(found)
    write_cameras(out, found, remarks=[f"from {', '.join(path.name for path in files)}"])
    content = {"cameras": [_content(one, assumed.get(one.name, [])) for one in found]}
    return Done(content | {"out": str(out)}, [*_lines(content["cameras"]), str(out)])


def _renamed(found: list[Instrument], name: str) -> Instrument:
    """Return the only instrument under another name.

    Raises
    ------
    SettingsError
        If there are several.
    """
    if len(found) > 1:
        raise SettingsError(f"there are {len(found)} cameras to name", "--name", "leave it out")
    (one,) = found
    pupil = None if one.pupil is None else replace(one.pupil, camera=name)
    return replace(one, name=name, pupil=pupil)


def _content(one: Instrument, assumed: list[str]) -> dict[str, Any]:
    """Return what ``--json`` prints of one camera."""
    camera = one.camera
    return {
        "name": one.name,
        "focal_length_mm": camera.focal_length_mm,
        "center": camera.center.tolist(),
        "k_matrix": camera.k_matrix.tolist(),
        "size": [camera.width, camera.height],
        "pixel_angle_rad": camera.pixel_angle,
        "distortion_model": camera.distortion_model,
        "distortion": camera.distortion.tolist(),
        "temperature_law": one.temperature is not None,
        "focus_positions": 0 if one.focus is None else len(one.focus.motor),
        "assumed": assumed,
    }


def _lines(cameras: list[dict[str, Any]]) -> list[str]:
    """Return what people read."""
    from spcola.camera.instrument import Assumed

    lines = []
    for one in cameras:
        lines += [
            f"{one['name']}: {one['focal_length_mm']:.6g} mm, {one['size'][0]} × {one['size'][1]} "
            f"pixels of {1e6 * one['pixel_angle_rad']:.4g} µrad, axis at "
            f"{one['center'][0]:.6g}, {one['center'][1]:.6g}, distortion {one['distortion_model']}",
            *(f"  {Assumed(reason).text}" for reason in one["assumed"]),
        ]
    return lines
