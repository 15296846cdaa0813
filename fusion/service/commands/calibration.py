"""What ``spcola camera calibrate`` does: a camera from stars."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, get_args

import typer

from fusion.service.commands.fields import Mark
from fusion.service.commands.site import Done, Site
from spcola.errors import NotObservableError, RejectedResultError, SettingsError

if TYPE_CHECKING:
    from spcola.camera import Camera
    from spcola.camera.instrument import Instrument
    from spcola.camera.stars import StarCalibration, StarFrame, StarPositions
    from spcola.formats.cameras.stars import NominalAttitude

__all__ = ["CalibrateOptions", "calibrate_camera"]


@dataclass(frozen=True)
class SolvedOptions:
    """Options that choose what is solved."""

    panel: ClassVar[str] = "What is solved"
    model: Annotated[
        str,
        typer.Option(
            metavar="MODEL", help="Distortion to solve; the file's if not given: owen, brown, …"
        ),
    ] = ""
    k_matrix: Annotated[
        bool, typer.Option("--k-matrix/--no-k-matrix", help="Solve Kxy and Kyy; Kxx is fixed.")
    ] = True
    center: Annotated[
        bool,
        typer.Option("--center", help="Solve the centre too: needs attitudes with a sigma."),
    ] = False
    distortion: Annotated[
        bool, typer.Option("--distortion/--no-distortion", help="Solve the distortion.")
    ] = True


@dataclass(frozen=True)
class MatchingOptions:
    """Options of the identification of stars."""

    panel: ClassVar[str] = "Identification of stars"
    search_px: Annotated[
        float, typer.Option(metavar="PX", min=1.0, max=1e4, help="Error of the attitudes, pixels.")
    ] = 50.0
    match_px: Annotated[
        float, typer.Option(metavar="PX", min=0.1, max=1e3, help="Error of the nominal camera.")
    ] = 3.0


@dataclass(frozen=True)
class CalibrateOptions:
    """Options of ``spcola camera calibrate``."""

    camera: Annotated[
        Path, typer.Argument(metavar="CAMERA", help="A camera file (TOML) with the nominal camera.")
    ]
    catalogue: Annotated[
        Path,
        typer.Option(metavar="TABLE", help="Stars: columns ra, dec (degrees) and mag."),
    ]
    attitudes: Annotated[
        Path,
        typer.Option(
            metavar="TABLE",
            help="Images: columns image, ra, dec, twist (degrees; from the east to the camera's x, "
            "towards the north); if known vx, vy, vz (km/s, barycentric), sigma (degrees, of an "
            "attitude that is known) and file (an image of any format of spcola images).",
        ),
    ]
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="FILE", help="Camera file to write."), Mark.OUTPUT
    ]
    stars: Annotated[
        Path | None,
        typer.Option(
            metavar="TABLE",
            help="Measured stars: columns image, pixel, line, and sigma (pixels; 0.1 without). If "
            "not given, stars are found in the files of the attitudes' table.",
        ),
    ] = None
    name: Annotated[
        str, typer.Option(metavar="NAME", help="The camera, if the file has several.")
    ] = ""
    solving: SolvedOptions = SolvedOptions()
    matching: MatchingOptions = MatchingOptions()


def calibrate_camera(site: Site, given: CalibrateOptions) -> Done:
    """Calibrate a camera from stars."""
    from spcola.camera.stars import calibrate as solve
    from spcola.camera.stars import solved_parameters
    from spcola.formats.cameras import write_cameras

    camera = given.camera
    nominal = _nominal(camera, given.name)
    start = _started(nominal.camera, given.solving.model)
    frames, left_out = _frames(start, site, given)
    solving = given.solving
    parameters = solved_parameters(
        start, k_matrix=solving.k_matrix, center=solving.center, distortion=solving.distortion
    )
    solved = solve(frames, start, parameters)
    if not solved.converged:
        raise RejectedResultError(
            f"the solution did not converge in {solved.iterations} iterations",
            camera,
            "solve fewer parameters, or give a better nominal camera",
        )
    used = sum(int(frame.used.sum()) for frame in solved.frames)
    remarks = [
        f"calibrated by {len(frames)} images, {used} stars",
        f"residual {solved.residual_rms:.4f} pixels rms, unit variance {solved.unit_variance:.3f}",
    ]
    write_cameras(given.out, [replace(nominal, camera=solved.camera)], remarks=remarks)
    content = _content(solved, nominal.camera, parameters.value(start).tolist())
    content |= {"name": nominal.name, "left_out": left_out, "out": str(given.out)}
    return Done(content, _lines(content))


def _nominal(path: Path, name: str) -> Instrument:
    """Return the camera of a file by its name, or the only one.

    Raises
    ------
    SettingsError
        If there is none of that name, or several and no name was given.
    """
    from spcola.formats.cameras import read_cameras

    found = read_cameras(path)
    if not name and len(found) == 1:
        return next(iter(found.values()))
    if name not in found:
        what = f"has no camera {name!r}" if name else f"has {len(found)} cameras"
        raise SettingsError(what, path, f"give --name, one of {', '.join(found)}")
    return found[name]


def _started(camera: Camera, model: str) -> Camera:
    """Return the nominal camera with the distortion model to solve.

    Raises
    ------
    SettingsError
        If the model is not known.
    """
    from spcola.camera import DistortionModel
    from spcola.camera.stars import with_model

    known = get_args(DistortionModel)
    if model and model not in known:
        raise SettingsError(f"{model!r} is no model", "--model", f"one of {', '.join(known)}")
    return with_model(camera, model or None)  # type: ignore[arg-type]  # is known


def _frames(
    camera: Camera, site: Site, given: CalibrateOptions
) -> tuple[list[StarFrame], dict[str, str]]:
    """Return the identified frames, and why other images were left out.

    Raises
    ------
    NotObservableError
        If no image is left.
    """
    from spcola.camera.stars import StarFrame, identified_frame
    from spcola.formats.cameras.stars import read_attitudes, read_star_catalogue

    sky, nominal = read_star_catalogue(given.catalogue), read_attitudes(given.attitudes)
    files = (one.file for one in nominal.values() if one.file is not None)
    site.check_inside(files, given.attitudes)
    tolerances = asdict(given.matching)
    measured = _measured(nominal, given.stars, camera)
    frames: list[StarFrame] = []
    left_out: dict[str, str] = {}
    for name, attitude in nominal.items():
        if name not in measured:
            left_out[name] = "has no measured stars"
            continue
        prior = StarFrame(name, measured[name], sky.directions[:0], attitude.axes, attitude.sigma)
        try:
            frame, _ = identified_frame(prior, camera, sky, attitude.velocity, **tolerances)
            frames.append(frame)
        except NotObservableError as error:
            left_out[name] = error.what
    left_out |= {name: "has no attitude" for name in measured if name not in nominal}
    if not frames:
        first = next(iter(left_out.items()), ("", "there is none"))
        raise NotObservableError(
            f"no image's stars were identified ({first[0]}: {first[1]})",
            where=given.attitudes,
            do="check attitudes, twist, camera and --search-px",
        )
    return frames, left_out


def _measured(
    attitudes: dict[str, NominalAttitude], stars: Path | None, camera: Camera
) -> dict[str, StarPositions]:
    """Return measured positions by image: of a table, or found in the images."""
    from spcola.camera.stars import find_stars
    from spcola.formats.cameras.stars import read_star_image, read_star_positions

    if stars is not None:
        return read_star_positions(stars)
    files = {name: one.file for name, one in attitudes.items() if one.file is not None}
    if not files:
        raise SettingsError(
            "no --stars are given, and the attitudes' table has no column file", "stars"
        )
    size = (camera.width, camera.height)
    return {name: find_stars(read_star_image(file, size=size)) for name, file in files.items()}


def _content(solved: StarCalibration, nominal: Camera, start: list[float]) -> dict[str, Any]:
    """Return what ``--json`` prints."""
    columns = zip(solved.names, solved.estimate, solved.sigma, start, strict=True)
    frames = []
    for frame in solved.frames:
        east, north, ahead = _angles_deg(frame.axes)
        frames.append(
            {
                "image": frame.name,
                "ra_deg": east,
                "dec_deg": north,
                "twist_deg": ahead,
                "sigma_rad": [float(v) ** 0.5 for v in frame.covariance.diagonal()],
                "stars": len(frame.used),
                "used": int(frame.used.sum()),
            }
        )
    return {
        "parameters": [
            {"name": n, "value": float(v), "sigma": float(s), "nominal": float(b)}
            for n, v, s, b in columns
        ],
        "covariance": solved.covariance.tolist(),
        "distortion_model": solved.camera.distortion_model,
        "fixed": {"k_xx": float(nominal.k_matrix[0, 0]), "k_yx": float(nominal.k_matrix[1, 0])},
        "unit_variance": solved.unit_variance,
        "residual_rms_px": solved.residual_rms,
        "iterations": solved.iterations,
        "frames": frames,
    }


def _angles_deg(axes: Any) -> tuple[float, float, float]:
    """Return right ascension, declination and twist of axes (3, 3), degrees."""
    from math import asin, atan2, degrees

    across, ahead = axes[0], axes[2]
    ra, dec = atan2(ahead[1], ahead[0]), asin(max(-1.0, min(1.0, float(ahead[2]))))
    east = across @ [-ahead[1], ahead[0], 0.0]
    north = across @ [-ahead[2] * ahead[0], -ahead[2] * ahead[1], 1.0 - ahead[2] ** 2]
    return degrees(ra) % 360.0, degrees(dec), degrees(atan2(north, east))


def _lines(content: dict[str, Any]) -> list[str]:
    """Return what people read."""
    used = sum(frame["used"] for frame in content["frames"])
    stars = sum(frame["stars"] for frame in content["frames"])
    lines = [
        f"{content['name']}: {len(content['frames'])} images, {used} of {stars} identified stars",
        *(
            f"  {one['name']}: {one['value']:.8g} ± {one['sigma']:.2g} (nominal "
            f"{one['nominal']:.6g})"
            for one in content["parameters"]
        ),
        f"  residual: {content['residual_rms_px']:.4f} pixels rms, unit variance "
        f"{content['unit_variance']:.3f}",
        *(f"  left out {image}: {reason}" for image, reason in content["left_out"].items()),
        content["out"],
    ]
    return [str(line) for line in lines]
