"""``--image-blur`` of ``spcola spc lithos`` and ``spc albedo``: two cameras, one of them moved."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import replace

import numpy as np
import pytest
from command_line import called, refused
from photographs import Waves
from scipy import ndimage
from solved_workspace import SIGHTS

from fusion.report.photoclinometry import image_strip
from fusion.workspace import Workspace, new_workspace
from fusion.workspace.solution_records import read_solution
from spcola.formats.images import write_image_data
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid
from spcola.heights.slopes import slopes_of

MAPLET, FAR = "AA0001", "AA0002"
TABLE = "image,psf_px,smear_sample_px,smear_line_px\nW*,1.2,0,0\nN*,0,0,0\nN3,0,5,0\n"
ROWS = [
    {"image": "W*", "psf_px": 1.2, "smear_px": [0.0, 0.0]},
    {"image": "N*", "psf_px": 0.0, "smear_px": [0.0, 0.0]},
    {"image": "N3", "psf_px": 0.0, "smear_px": [5.0, 0.0]},
]
RUN = ("spc", "lithos", "--constraint", "none", "--photometry", "lambert", "--only", MAPLET)


def blurred(image):
    """Pixels as the wide camera W sees them, and as N3 does: a mean of five sub-frames."""
    pixels = image.pixels.astype(float)
    if image.name.startswith("W"):
        pixels = ndimage.gaussian_filter(pixels, 1.2)
    elif image.name == "N3":
        pixels = ndimage.uniform_filter1d(pixels, 5, axis=1)
    return replace(image, pixels=np.rint(pixels).astype(np.uint16))


@pytest.fixture(scope="module")
def ground():
    return Waves(MapletGrid.facing([80.0, 20.0, 10.0], [0.9, 0.3, 0.2], 0.5, 20))


@pytest.fixture(scope="module")
def root(ground, tmp_path_factory):
    """A workspace of two maplets and five images: of the first, W0, W1 and W2, N3 and N4."""
    made = new_workspace(tmp_path_factory.mktemp("blur") / "WS", body="Waves")
    far = MapletGrid.facing([-80.0, -20.0, -10.0], [-0.9, -0.3, -0.2], 0.5, 20)
    for name, grid in {MAPLET: ground.grid, FAR: far}.items():
        write_maplet(made.maplet_path(name), Maplet(name, grid, np.zeros(grid.shape)))
    for number, sight in enumerate(SIGHTS):
        name = f"{'W' if number < 3 else 'N'}{number}"
        image = blurred(ground.photograph(name, *sight, size=72))
        write_image_data(made.exposure_path(name), image.pixels)
        write_summary(made.image_path(name), image)
    (made.root / "blur.csv").write_text(TABLE)
    return made.root


@pytest.fixture(scope="module")
def solved(root):
    """What the command printed, without and with the table."""
    without = called(*RUN, root, "--as", "without")
    return without, called(*RUN, root, "--image-blur", root / "blur.csv", "--as", "with")


def slope_error(root, solution, ground):
    """Root mean square of the errors of slopes over two cells."""
    height = Workspace.open(root, solution).maplet(MAPLET).height
    wrong = np.array(slopes_of(height - ground.heights(), ground.grid.gsd))
    return np.sqrt(np.mean(wrong[:, 4:-4, 4:-4] ** 2))


def test_slopes_are_better_with_the_blur_of_each_image(root, ground, solved):
    assert slope_error(root, "with", ground) < 0.6 * slope_error(root, "without", ground)
    unlike = [1.0 - one["images"]["N3"]["correlation"] for one in solved]
    assert unlike[1] < 0.8 * unlike[0]


def test_the_solution_states_which_blur_each_image_has(root, solved):
    assert solved[0]["options"]["image_blur"] == []
    assert solved[1]["options"]["image_blur"] == ROWS
    record = read_solution(root, "with")
    assert record.facts["lithos"]["image_blur"] == ROWS
    assert record.digests["blur.csv"] == hashlib.sha256(TABLE.encode()).hexdigest()
    assert "blur.csv" not in read_solution(root, "without").digests


def test_renderings_of_the_report_are_blurred_as_the_image_is(root, solved):
    """Of the smeared image: its rendering has its contrast, also when the table is gone."""
    expected = []
    for name in ("with", "without"):
        workspace = Workspace.open(root, name)
        content = workspace.read_json("photoclinometry.json")
        maplet = Workspace.open(root, "with").maplet(MAPLET)
        strip = image_strip(workspace, content, maplet, "N3", None).astype(float)
        size = maplet.grid.size
        inner = slice(5, -5)
        rendered = strip[inner, size + 2 : 2 * size + 2][:, inner]
        image = strip[inner, :size][:, inner]
        expected.append(np.std(rendered - image))
    assert expected[0] < 0.7 * expected[1]


def test_settings_name_the_table_relative_to_the_workspace(root, ground, solved, tmp_path):
    copy = tmp_path / "WS"
    shutil.copytree(root, copy, symlinks=True)
    path = copy / "spcola.toml"
    text = path.read_text()
    assert 'image_blur = ""' in text
    path.unlink()
    path.write_text(text.replace('image_blur = ""', 'image_blur = "blur.csv"'))
    items = copy / ".items" / "lithos"
    before = {one.name for one in items.iterdir()}
    assert called(*RUN, copy, "--as", "again")["maplets"] == solved[1]["maplets"]
    assert {one.name for one in items.iterdir()} == before
    # The blur of an image counts for the maplets that it shows.
    (copy / "blur.csv").unlink()
    (copy / "blur.csv").write_text(TABLE.replace("N3,0,5,0", "N3,0,2,0"))
    changed = called(*RUN, copy, "--as", "changed")
    assert changed["maplets"] != solved[1]["maplets"]
    assert len(list(items.iterdir())) == len(before) + 1
    (copy / "blur.csv").unlink()
    (copy / "blur.csv").write_text("# W and N\n" + TABLE.replace("W*,1.2", "W*,1.20"))
    assert called(*RUN, copy, "--as", "same")["maplets"] == solved[1]["maplets"]
    assert len(list(items.iterdir())) == len(before) + 1


def test_albedo_is_solved_with_the_blur_of_each_image(root, solved):
    given = ("spc", "albedo", root, "--solution", "with", "--photometry", "lambert")
    more = ("--image-blur", root / "blur.csv")
    without, right = (
        called(*given, "--only", MAPLET, *table, "--as", name)
        for name, table in (("bare", ()), ("blurred", more))
    )
    assert right["options"]["image_blur"] == ROWS
    assert right["residual"] < 0.7 * without["residual"]
    # Ground of one albedo.
    assert right["surfaces"][MAPLET]["scatter"] < 0.8 * without["surfaces"][MAPLET]["scatter"]
    digests = read_solution(root, "blurred").digests
    assert digests["blur.csv"] == hashlib.sha256(TABLE.encode()).hexdigest()


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("N3,0,five,0", "blur.csv, line 4, column smear_sample_px: 'five' is not a number"),
        ("X9,0,0,0", "blur.csv, line 4, column image: X9 names no image"),
        ("*3,0,0,0", "*3 names N3, as N* does in line 3; add a row for N3"),
    ],
)
@pytest.mark.parametrize("command", ["lithos", "albedo"])
def test_a_wrong_table_is_refused_in_one_line(root, tmp_path, command, row, words):
    path = tmp_path / "blur.csv"
    path.write_text(TABLE.replace("N3,0,5,0", row))
    assert words in refused("spc", command, root, "--image-blur", path)
    assert (
        "no such file"
        in refused("spc", command, root, "--image-blur", tmp_path / "none.csv").lower()
    )
