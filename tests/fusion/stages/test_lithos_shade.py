"""``spcola spc lithos --secondary-light``: ground in the shade, on a small mission."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from command_line import called, refused

from fusion.report.photoclinometry import image_strip
from fusion.stages.lithos.shade import looks_at
from fusion.workspace import Workspace
from spcola.camera import project_image
from spcola.formats.images import read_image_data, write_image_data
from spcola.grids import MapletGrid
from spcola.heights.slopes import slopes_of
from spcola.photometry.functions import lunar_lambert
from spcola.photometry.secondary_light import secondary_light
from spcola.shape import RayCaster
from spcola.truth.body import TruthBody

# Nine tenths of it are in the shade of these images.
NAME, IMAGES = "TR0002", ("P01I01", "P01I03")
# Brightest ground in the shade; the lower threshold of the images is 256.
MOST = 240.0


def true_heights(settings, grid):
    back = settings.to_spc.inverse()
    there = MapletGrid(
        back.apply(grid.center), back.turn(grid.axes), grid.gsd * back.scale, grid.half_size
    )
    return TruthBody(settings.body).heights_near(there, np.zeros(grid.shape)) / back.scale


def add_light(workspace, settings, name):
    """Give pixels in the shade the brightness of the true ground there, in secondary light."""
    maplet, image = workspace.maplet(NAME), workspace.image(name)
    light = secondary_light(maplet, image, RayCaster(workspace.shape()), lunar_lambert)
    grid = maplet.grid.with_gsd(maplet.grid.gsd / 3.0)
    height = true_heights(settings, grid)
    steep = np.stack([*(-np.array(slopes_of(height, grid.gsd))), np.ones(grid.shape)], axis=-1)
    normal = steep / np.linalg.norm(steep, axis=-1, keepdims=True) @ grid.axes
    points = grid.points(height)
    eye = image.position - points
    eye /= np.linalg.norm(eye, axis=-1, keepdims=True)
    bright = np.zeros(grid.shape)
    x, y = np.meshgrid(grid.offsets, grid.offsets) * np.array(grid.gsd / light.grid.gsd)
    for direction, layer in zip(light.directions, light.irradiance, strict=True):
        phase = np.arccos(np.clip(eye @ direction, -1.0, 1.0))
        shade = lunar_lambert(normal @ direction, np.sum(normal * eye, axis=-1), phase)
        bright += light.grid.interpolated(layer, x, y) * shade
    sample, line = (np.rint(place).astype(int) - 1 for place in project_image(image, points))
    size = image.camera.width
    place = (line * size + sample).ravel()
    count = np.bincount(place, minlength=size**2)
    mean = np.bincount(place, bright.ravel(), size**2) / np.maximum(count, 1)
    path = workspace.exposure_path(name)
    pixels = read_image_data(path, size, size).astype(float)
    dark = (pixels < MOST) & (count.reshape(size, size) >= 4)
    pixels[dark] = 1.0 + (MOST - 1.0) * mean.reshape(size, size)[dark] / mean[dark.ravel()].max()
    path.unlink()
    write_image_data(path, np.rint(pixels).astype(np.uint16))
    return int(dark.sum())


@pytest.fixture(scope="module")
def shaded(imaged_mission, tmp_path_factory):
    """A copy of its own with light in the shade of two images, and the settings."""
    root = tmp_path_factory.mktemp("shade") / "WS"
    shutil.copytree(imaged_mission[0], root, symlinks=True)
    shutil.rmtree(root / "solutions", ignore_errors=True)
    workspace = Workspace.open(root)
    assert all(add_light(workspace, imaged_mission[1], name) > 250 for name in IMAGES)
    return root, imaged_mission[1]


def solved(root, name, *more):
    given = ("--only", NAME, "--start", "shape", "--constraint", "shape", "--as", name)
    return called("spc", "lithos", root, *given, *more)


def slope_error(shaded, solution):
    root, settings = shaded
    maplet = Workspace.open(root, solution).maplet(NAME)
    true = true_heights(settings, maplet.grid)
    wrong = np.array(slopes_of(maplet.height - true, maplet.grid.gsd))[:, 2:-2, 2:-2]
    return np.sqrt(np.mean(wrong**2))


def test_images_count_in_the_shade(shaded):
    root = shaded[0]
    lights = [part for name in IMAGES for part in ("--secondary-light", name)]
    without, content = solved(root, "sun"), solved(root, "shade", *lights)
    assert content["options"]["secondary_light"] == list(IMAGES)
    fits = content["maplets"][NAME]["images"]
    for name in IMAGES:
        own = fits[f"{name} in shade"]
        assert own["fit"] == "used"
        assert own["correlation"] > 0.7
        assert own["pixels"] > 50
    assert not any("shade" in name for name in without["maplets"][NAME]["images"])
    assert slope_error(shaded, "shade") < 0.98 * slope_error(shaded, "sun")
    nothing, _, both = zip(
        *(one["maplets"][NAME]["directions"] for one in (without, content)), strict=True
    )
    assert nothing[1] < nothing[0]
    assert both[1] > both[0]
    codes = strip(shaded[0], content, f"{IMAGES[0]} in shade")
    assert len(np.unique(codes)) > 20


def strip(root, content, image):
    """The picture of an image on the maplet, as report and page have it."""
    workspace = Workspace.open(root, "shade")
    return image_strip(
        workspace, content, workspace.maplet(NAME), image, RayCaster(workspace.shape())
    )


def test_maplets_in_sunlight_are_solved_as_before(shaded):
    """An image looks at many maplets; only some of them are in the shade."""
    root, name = shaded[0], "TR0010"
    workspace = Workspace.open(root)
    assert looks_at(workspace.image("P03I02"), workspace.maplet(name).grid)
    given = ("spc", "lithos", root, "--only", name, "--rounds", "1", "--start", "shape")
    content = called(*given, "--secondary-light", "P03I02")
    assert content["maplets"] == called(*given)["maplets"]


def test_images_that_cannot_show_shade_are_refused(shaded, tmp_path):
    root = tmp_path / "WS"
    shutil.copytree(shaded[0], root, symlinks=True)
    given = ("spc", "lithos", root, "--only", NAME)
    words = refused(*given, "--secondary-light", "NONE")
    assert "has no pixels of the size of its .SUM, or no state" in words
    path = root / "SUMFILES" / "P01I01.SUM"
    text = path.read_text().replace("   256 65534", "     0 65534")
    path.unlink()
    path.write_text(text)
    line = refused(*given, "--secondary-light", "P01I01")
    assert "lower threshold is 0" in line
    assert "THRSH" in line
