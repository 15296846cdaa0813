"""Images that cannot be used are named by ``spc lithos`` and ``spc albedo``; others are used."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from command_line import call, called, refused
from photographs import Painted
from scipy import ndimage
from solved_workspace import SIGHTS

from fusion.stages.bad_images.findings import state_findings, unusable
from fusion.stages.bad_images.outlines import Outline
from fusion.workspace import Workspace, new_workspace
from spcola.camera import Camera, SpcImage, ray
from spcola.formats.images import write_image_data
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid
from spcola.imagematching import ChoiceOptions
from spcola.imagematching.frames.mistakes import BodyOutline
from spcola.photometry.photoclinometry.surface import cell_slopes

PLACE, NORMAL = np.array([80.0, 20.0, 10.0]), np.array([0.9, 0.3, 0.2])
MAPLET, FAR = "AA0001", "AA0002"
GOOD = [f"I{k}" for k in range(len(SIGHTS))]
RUN = ("--constraint", "none", "--photometry", "lambert")
EVEN = ("--photometry", "lambert")
"""Options of ``spc albedo``."""


def sun_negated(image):
    return replace(image, sun=-image.sun)


def turned_away(image):
    return replace(image, axes=image.axes * [[1.0], [-1.0], [-1.0]])


def of_another_size(image):
    camera = replace(image.camera, width=image.camera.width - 4)
    return replace(image, pixels=None, camera=camera)


def filled(value):
    return lambda image: replace(image, pixels=np.full_like(image.pixels, value))


def add_image(workspace, image, change=lambda image: image):
    """Write an image, its state or its pixels changed."""
    pixels, changed = image.pixels, change(image)
    kept = pixels if changed.pixels is None else changed.pixels
    for path in (workspace.exposure_path(image.name), workspace.image_path(image.name)):
        path.unlink(missing_ok=True)
    write_image_data(workspace.exposure_path(image.name), kept)
    write_summary(workspace.image_path(image.name), changed)


@pytest.fixture(scope="module")
def ground():
    return Painted(MapletGrid.facing(PLACE, NORMAL, 0.5, 16))


@pytest.fixture(scope="module")
def photographs(ground):
    return [ground.photograph(f"I{k}", *sight, size=64) for k, sight in enumerate(SIGHTS)]


@pytest.fixture(scope="module")
def good(ground, photographs, tmp_path_factory):
    """A workspace of right images of one of two maplets, and what solving it prints."""
    made = new_workspace(tmp_path_factory.mktemp("lithos") / "good", body="Waves")
    grids = {MAPLET: ground.grid, FAR: MapletGrid.facing(-PLACE, -NORMAL, 0.5, 16)}
    for name, grid in grids.items():
        write_maplet(made.maplet_path(name), Maplet(name, grid, np.zeros(grid.shape)))
    for image in photographs:
        add_image(made, image)
    return made.root, called("spc", "lithos", made.root, *RUN, "--as", "right")


@pytest.fixture
def root(good, tmp_path):
    """A copy of the workspace of right images."""
    copy = tmp_path / "WS"
    shutil.copytree(good[0], copy, symlinks=True)
    shutil.rmtree(copy / "solutions")
    shutil.rmtree(copy / ".items", ignore_errors=True)
    return copy


def add_bad_images(workspace, photograph):
    """Add an image of each kind that cannot be used."""
    bad = {
        "S": sun_negated, "A": turned_away, "W": of_another_size,
        "B": filled(65535), "D": filled(0),
    }  # fmt: skip
    for name, change in bad.items():
        add_image(workspace, replace(photograph, name=name), change)


NAMED = [
    ("image-size", ["W"]),
    ("looks-away", ["A"]),
    ("no-sunlit-ground", ["S"]),
    ("image-unusable", ["D"]),
    ("image-unusable", ["B"]),
]


def codes(content):
    return {one["code"]: one["names"] for one in content["findings"]}


def test_right_images_are_no_finding_even_where_they_show_another_maplet(good):
    root, content = good
    assert codes(content) == {"too-few-images": [FAR]}
    other = called("spc", "lithos", root, *RUN, "--only", FAR)
    assert codes(other) == {"too-few-images": [FAR]}


def test_each_bad_image_is_named_with_its_cause_and_the_others_are_solved(good, root, photographs):
    add_bad_images(Workspace.open(root), photographs[0])
    content = called("spc", "lithos", root, *RUN, "--only", MAPLET, "--as", "bad")
    found = [(one["code"], one["names"]) for one in content["findings"]]
    assert found == NAMED
    do = [one["do"] for one in content["findings"]]
    assert "W: 8192 bytes, where 60 × 64 pixels need 3840 or twice that" in do[0]
    assert "Cy and Cz have the wrong sign" in do[1]
    assert "the vector to the Sun has the wrong sign" in do[2]
    assert "as dark as shadow" in do[3]
    assert "saturated" in do[4]
    fits = {name: one["fit"] for name, one in content["maplets"][MAPLET]["images"].items()}
    assert {name for name, fit in fits.items() if fit == "used"} == set(GOOD)
    assert content["maplets"][MAPLET]["outcome"] == good[1]["maplets"][MAPLET]["outcome"]
    one, other = (
        Workspace.open(where, name).maplet(MAPLET).height
        for where, name in ((good[0], "right"), (root, "bad"))
    )
    np.testing.assert_allclose(one, other, atol=1e-3)


def test_albedo_names_the_same_images_and_uses_the_others(root, photographs):
    right = called("spc", "albedo", root, "--only", MAPLET, *EVEN, "--as", "right")
    assert not {code for code, _ in NAMED} & set(codes(right))
    add_bad_images(Workspace.open(root), photographs[0])
    content = called("spc", "albedo", root, "--only", MAPLET, *EVEN, "--as", "bad")
    found = [(one["code"], one["names"]) for one in content["findings"]]
    assert found[: len(NAMED)] == NAMED
    assert found[len(NAMED) :] == [(one["code"], one["names"]) for one in right["findings"]]
    fits = {name: one["fit"] for name, one in content["surfaces"][MAPLET]["images"].items()}
    assert {name for name, fit in fits.items() if fit != "not-seen"} == set(GOOD)
    one, other = (Workspace.open(root, name).maplet(MAPLET).albedo for name in ("right", "bad"))
    np.testing.assert_array_equal(one, other)


def test_suns_that_are_all_negated_are_named_before_the_maplet_without_images(root, photographs):
    for image in photographs:
        add_image(Workspace.open(root), image, sun_negated)
    lines = call("spc", "lithos", root, *RUN).stdout.splitlines()
    named = [line for line in lines if "no-sunlit-ground" in line]
    assert len(named) == 1
    assert "I0, I1, I2, I3, I4" in named[0]
    assert "the vector to the Sun has the wrong sign" in named[0]
    too_few = next(k for k, line in enumerate(lines) if "too-few-images:" in line)
    assert lines.index(named[0]) < too_few


def test_files_of_another_depth_than_their_length_lets_expect_are_named(root, photographs):
    workspace = Workspace.open(root)
    half, twice = GOOD[:2]
    path = workspace.exposure_path(half)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    # Eight bits, and NLN of another image.
    wide = ndimage.zoom(photographs[1].pixels, 2, order=1) // 100
    write_image_data(workspace.exposure_path(twice), wide[::2].astype(np.uint8))
    content = called("spc", "lithos", root, *RUN, "--only", MAPLET)
    assert codes(content)["image-size"] == [half, twice]
    assert (
        "4096 bytes, one byte for each of 64 × 64 pixels, but they look like 2048 pixels of two"
        in (content["findings"][0]["do"])
    )
    assert set(content["maplets"][MAPLET]["images"]) == set(GOOD[2:])
    assert codes(called("spc", "albedo", root, "--only", MAPLET, *EVEN))["image-size"] == [
        half,
        twice,
    ]
    path.unlink()
    shutil.copy(workspace.exposure_path(twice), path)
    for other in GOOD[2:]:
        workspace.exposure_path(other).unlink()
    # The first image stands for all of them.
    refusal = refused("spc", "lithos", root, *RUN)
    assert "8192 bytes, two bytes for each of 64 × 64 pixels" in refusal
    assert "look like 8192 pixels of one" in refusal


def test_eight_bits_are_right_as_they_are(root, photographs):
    workspace = Workspace.open(root)
    for image in photographs:
        eight = replace(image, pixels=(image.pixels // 100).astype(np.uint8), thresholds=(1, 254))
        add_image(workspace, eight)
    found = called("spc", "lithos", root, *RUN, "--only", MAPLET)
    assert not found["findings"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (turned_away, "the body is not in the frame"),
        (of_another_size, "no image file has the size of its .SUM; I0 has 8192 bytes"),
    ],
)
def test_a_run_without_any_image_left_is_refused_and_writes_nothing(
    root, photographs, change, words
):
    for image in photographs:
        add_image(Workspace.open(root), image, change)
    assert words in refused("spc", "lithos", root, *RUN)
    assert words in refused("spc", "albedo", root, *EVEN)
    assert not list(root.glob("solutions/*"))


def test_one_right_image_is_too_few_and_is_not_named_as_wrong(root):
    workspace = Workspace.open(root)
    for name in GOOD[1:]:
        workspace.exposure_path(name).unlink()
        workspace.image_path(name).unlink()
    called("spc", "lithos", root, *RUN, "--as", "one")
    content = Workspace.open(root, "one").read_json("photoclinometry.json")
    assert codes(content) == {"too-few-images": [MAPLET, FAR]}


def test_some_files_of_another_size_do_not_hide_what_is_wrong_with_the_others(root, photographs):
    for image in photographs:
        change = of_another_size if image.name == "I0" else turned_away
        add_image(Workspace.open(root), image, change)
    words = refused("spc", "lithos", root, *RUN)
    assert "by the state of I1, the body is not in the frame" in words
    assert "(1 of another size than their .SUM)" in words


class Boulders(Painted):
    """The waves with 25 boulders, 0.5 m high."""

    def __init__(self, grid, seed):
        super().__init__(grid)
        self.places = np.random.default_rng(seed).uniform(-7.0, 7.0, (25, 2))

    def boulders(self, x, y):
        """Places and heights (…, 25) of the boulders about points."""
        aside, up = x[..., None] - self.places[:, 0], y[..., None] - self.places[:, 1]
        return aside, up, 0.5 * np.exp(-(aside**2 + up**2))

    def height(self, x, y):
        return super().height(x, y) + self.boulders(x, y)[2].sum(axis=-1)

    def slopes(self, x, y):
        along_x, along_y = super().slopes(x, y)
        aside, up, height = self.boulders(x, y)
        return along_x - 2.0 * (aside * height).sum(-1), along_y - 2.0 * (up * height).sum(-1)


def test_an_image_of_another_boulder_field_is_named(root, ground):
    for k, sight in enumerate(SIGHTS):
        field = Boulders(ground.grid, seed=1 if k else 2)
        add_image(Workspace.open(root), field.photograph(f"I{k}", *sight, size=64))
    called("spc", "lithos", root, *RUN, "--as", "boulders")
    content = Workspace.open(root, "boulders").read_json("photoclinometry.json")
    assert codes(content)["image-residual"] == ["I0"]


def bloomed(image, column):
    """An image with 18 saturated pixels of a column, and fringes that are too bright."""
    pixels, rows = image.pixels.astype(np.float64), slice(22, 40)
    for aside, factor in ((1, 1.8), (2, 1.3)):
        pixels[rows, [[column - aside], [column + aside]]] *= factor
    pixels[rows, column] = 65535
    return replace(image, pixels=np.rint(pixels).astype(np.uint16))


def test_fringes_of_blooming_do_not_count(good, root, ground, photographs):
    workspace, columns = Workspace.open(root), (22, 27, 31, 36, 41)
    for image, column in zip(photographs, columns, strict=True):
        add_image(workspace, image, lambda one, column=column: bloomed(one, column))
    found = called("spc", "lithos", root, *RUN, "--only", MAPLET, "--as", "bloomed")
    assert not found["findings"]
    wrong = [
        cell_slopes(Workspace.open(where, name).maplet(MAPLET).height - ground.heights(), 0.5)
        for where, name in ((good[0], "right"), (root, "bloomed"))
    ]
    right, with_fringes = (np.sqrt(np.mean(one[:, 4:-4, 4:-4] ** 2)) for one in wrong)
    # 1.31 times, as five columns of an image show nothing; 1.80 if fringes count.
    assert with_fringes < 1.4 * right


def test_dark_ground_of_an_image_that_is_lit_elsewhere_is_shadow(photographs, ground):
    half = np.array(photographs[0].pixels)
    half[8:-8, 8:-8] = 0
    assert unusable(replace(photographs[0], pixels=half), [ground.grid]) == ""
    assert unusable(replace(photographs[0], pixels=0 * half), [ground.grid]) == "dark"
    half[8:-8, 8:-8] = 65535
    assert unusable(replace(photographs[0], pixels=half), [ground.grid]) == "saturated"


def test_with_a_shape_a_negated_sun_is_seen_in_the_pixels(imaged_mission, tmp_path):
    root = tmp_path / "WS"
    shutil.copytree(imaged_mission[0], root, symlinks=True)
    workspace, asked = Workspace.open(root), "TR0009"
    run = ("spc", "lithos", root, *RUN, "--rounds", "1", "--only", asked)
    right = called(*run, "--as", "one")
    shown = sorted(right["maplets"][asked]["images"])
    assert not {"sun-reversed", "no-sunlit-ground", "looks-away"} & set(codes(right))
    for name, change in zip(shown, (sun_negated, turned_away), strict=False):
        image = workspace.image(name)
        workspace.image_path(name).unlink()
        write_summary(workspace.image_path(name), change(image))
    found = codes(called(*run, "--as", "other"))
    assert found["sun-reversed"] == [shown[0]]
    assert found["looks-away"] == [shown[1]]


def whole_disc(sun, *, stated):
    """An image of a ball of 50 m in the light of one Sun, with the state of another."""
    size, distance = 80, 5000.0
    axes = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    camera = Camera(100.0, [40.5, 40.5], [[33.0, 0, 0], [0, 33.0, 0]], size, size)
    place = np.array([distance, 0.0, 0.0])
    line, column = np.indices((size, size)) + 1.0
    beams = ray(SpcImage("I", "", camera, -place, axes, stated), column, line)
    along = -beams @ place
    under = along**2 - distance**2 + 50.0**2
    points = place + (along - np.sqrt(np.maximum(under, 0.0)))[..., None] * beams
    lit = np.where(under > 0.0, np.maximum(points @ sun / 50.0, 0.0), 0.0)
    pixels = np.rint(20000.0 * lit).astype(np.uint16)
    return SpcImage("I", "", camera, -place, axes, stated, (100, 65000), pixels=pixels)


@pytest.mark.parametrize(
    ("degrees", "negated", "is_reversed"),
    [(30.0, True, True), (30.0, False, False), (160.0, False, False)],
)
def test_a_whole_disc_in_low_phase_shows_its_negated_sun_and_a_crescent_is_right(
    degrees, negated, is_reversed
):
    rng = np.random.default_rng(2)
    normals = rng.normal(size=(3000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    outline = Outline(BodyOutline(np.zeros(3), 50.0, 50.0 * normals, normals), normals)
    phase = np.radians(degrees)
    sun = np.array([np.cos(phase), np.sin(phase), 0.0])
    image = whole_disc(sun, stated=-sun if negated else sun)
    choice = ChoiceOptions()
    assert outline.mostly_dark(image, choice) == (negated or degrees > 90.0)
    assert outline.lit_from_the_other_side(image, choice) == is_reversed
    looks_reversed = [image.name] if is_reversed else []
    found = [one["code"] for one in state_findings(outline, [image], looks_reversed)]
    assert found == (["sun-reversed"] if is_reversed else [])
