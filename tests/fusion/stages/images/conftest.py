"""A mission to a box: images, a table of their poses, a camera file and a shape."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.workspace import new_workspace
from spcola.camera.instrument import Instrument
from spcola.formats.cameras import write_cameras
from spcola.formats.shapes import write_obj_mesh
from spcola.imagematching.frames import render_frame
from spcola.shape import RayCaster

from .box_mission import CAMERA, SIZE, fits_file, image_at, shape_of


@pytest.fixture(scope="session")
def given(tmp_path_factory):
    """A folder with six images, a table of their poses, a camera file and a shape."""
    folder = tmp_path_factory.mktemp("given")
    mesh = shape_of()
    write_obj_mesh(folder / "box.obj", mesh)
    caster, rng = RayCaster(mesh), np.random.default_rng(1)
    lines = ["image,utc,v0x_m,v0y_m,v0z_m,cxx,cxy,cxz,cyx,cyy,cyz,czx,czy,czz,sunx,suny,sunz"]
    for number in range(6):
        image = image_at(number)
        frame = 3000.0 * render_frame(caster, image).brightness + rng.normal(200, 5, (SIZE, SIZE))
        fits_file(folder / f"frame_of_a_mission_{number}.fit", frame.astype(np.uint16), number)
        values = [*image.scobj, *image.axes.ravel(), *image.sun]
        name = f"frame_of_a_mission_{number}"
        lines.append(",".join([name, image.utc, *(repr(float(v)) for v in values)]))
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    write_cameras(folder / "camera.toml", [Instrument("NAC", CAMERA, None, None, None)])
    return folder


@pytest.fixture
def made(given, tmp_path):
    return new_workspace(tmp_path / "ws", body="Box", shape=given / "box.obj")
