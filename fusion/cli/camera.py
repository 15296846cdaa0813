"""``spcola camera``: calibrate a camera from stars, and convert camera files."""

from __future__ import annotations

from pathlib import Path

import typer

from fusion.cli.options import JsonOption, PanelCommand, site_of, with_shared_options
from fusion.cli.output import show
from fusion.cli.program import guarded
from fusion.service.commands.calibration import CalibrateOptions, calibrate_camera
from fusion.service.commands.camera_files import ConvertOptions, convert_cameras

app = typer.Typer(
    name="camera",
    help="Calibrate cameras; convert camera files.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


def calibrate(given: CalibrateOptions, as_json: JsonOption = False) -> None:
    """Calibrate a camera from stars: focal length, K-matrix, distortion and attitudes.

    Stars are identified in each image by its approximate attitude. Images whose stars cannot be
    identified are left out, with the reason; false stars are rejected. The camera file that is
    written has the solved camera with all digits; the result has sigmas and the covariance.
    """
    show(*calibrate_camera(site_of(Path(), as_json=as_json), given), as_json=as_json)


def convert(given: ConvertOptions, as_json: JsonOption = False) -> None:
    """Write cameras of other formats as a camera file.

    The pixel convention becomes that of SPC: the centre of the first pixel is (1, 1). With
    --temperature, --range or --motor the camera is written as it is then, without its laws; what is
    not known stays nominal, which is printed.
    """
    show(*convert_cameras(site_of(Path(), as_json=as_json), given), as_json=as_json)


app.command(
    "calibrate",
    cls=PanelCommand,
    epilog="Example: spcola camera calibrate nac.toml --catalogue tycho.csv --attitudes "
    "cruise.csv --stars stars.csv -o nac_calibrated.toml",
)(guarded(with_shared_options(calibrate)))
app.command(
    "convert",
    epilog="Example: spcola camera convert orx_ocams_v07.ti orex_ocams_addendum_v10.ti "
    "--number -64360 --filter PAN --range 750 -o polycam.toml",
)(guarded(with_shared_options(convert)))
