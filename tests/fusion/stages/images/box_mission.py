"""A mission to a box: images with states, for tests of ``spcola images``."""

from __future__ import annotations

import json

import numpy as np
from astropy.io import fits
from command_line import app
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from spcola.camera import Camera, SpcImage
from spcola.navigation import et_from_utc, utc_from_et
from spcola.shape import Mesh

SIZE = 128
CAMERA = Camera(125.2, [64.5, 64.5], [[117.6, 0, 0], [0, 117.6, 0]], SIZE, SIZE)
START = et_from_utc("2019-03-03T10:59:40")
SUN = np.array([0.6, -0.64, 0.48])


def call(*arguments, code=0):
    result = CliRunner().invoke(app, list(map(str, arguments)))
    assert result.exit_code == code, result.output + result.stderr
    return result


def content(*arguments):
    return json.loads(call(*arguments, "--json").stdout)


def refusal(*arguments):
    (line,) = call(*arguments, code=1).stderr.splitlines()
    return line


def shape_of():
    """A box with three different sides and a wedge: no symmetry."""
    x, y, z = 150.0, 100.0, 70.0
    low = [[-x, -y, -z], [x, -y, -z], [x, y, -z], [-x, y, -z]]
    top = [[-x, -y, z], [0.2 * x, -y, z], [x, y, 0.6 * z], [-x, 0.5 * y, 2.0 * z]]
    quads = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    facets = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    return Mesh(np.array(low + top), np.array(facets), "box")


def image_at(number):
    away = Rotation.from_euler("ZX", [15.0 * number, 12.0 * number], degrees=True).apply(
        [0.5, -0.7, 0.5]
    )
    place = 70_000.0 * away / np.linalg.norm(away)
    looking = Rotation.align_vectors([[0, 0, 1.0]], [-place])[0]
    axes = (Rotation.from_rotvec([0.0002, 0.0003, number]) * looking).as_matrix()
    utc = utc_from_et(START + 60.0 * number)
    return SpcImage(f"P{number:04d}", utc, CAMERA, -place, axes, SUN / np.linalg.norm(SUN))


def fits_file(path, dn, number=0, **header):
    unit = fits.PrimaryHDU(dn)
    unit.header["DATE-OBS"] = utc_from_et(START + 60.0 * number - 0.01, 6)
    unit.header["EXPTIME"] = 0.02
    unit.header.update(header)
    unit.writeto(path)
    return path


def files(given, *numbers):
    return [given / f"frame_of_a_mission_{n}.fit" for n in (numbers or range(6))]


def states(given):
    return ["--poses", given / "poses.csv", "--camera", given / "camera.toml"]


def tree(root):
    """All files but those of work, by their names."""
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and not path.relative_to(root).parts[0].startswith(".")
    }
