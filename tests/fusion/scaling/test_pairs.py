from __future__ import annotations

import numpy as np
import pytest

from fusion.estimation.verdict import Cause
from fusion.scaling.geometry import PairOptions, UnpairedImage, frame_of_image, pair_size
from fusion.scaling.geometry.frames import local_time
from fusion.scaling.pairs import Pair, PairSources, make_pair, pair_observations, rematch
from fusion.surfacematch import MatchOptions
from lidar.scans import Returns
from spcola.camera import Camera, SpcImage
from spcola.grids import Maplet
from spcola.shape import Mesh, RayCaster

CAMERA = Camera(125.0, [512.5, 512.5], [[117.0, 0, 0], [0, 117.0, 0]], 1024, 1024)
OPTIONS = PairOptions(size_m=40.0, gsd_m=0.5, match=MatchOptions(capture_m=3.0))
SOURCES = PairSources("S", np.zeros(1), np.zeros((1, 3, 3)), np.ones(1))
CUBE = Mesh(
    50.0 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]),
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ],
)


def image(position, aim, name="I1", sun=(1.0, 1.0, 0.0)):
    cz = np.subtract(aim, position)
    cz = cz / np.linalg.norm(cz)
    cx = np.cross([0.0, 0.0, 1.0], cz)
    cx /= np.linalg.norm(cx)
    return SpcImage(
        name,
        "2019 MAR 07 12:00:00",
        CAMERA,
        -np.asarray(position, dtype=float),
        np.stack([cx, np.cross(cz, cx), cz]),
        np.divide(sun, np.linalg.norm(sun)),
    )


def relief(y, z):
    """Hills of some metres on the +X face of the cube."""
    return (
        0.8 * np.sin(y / 2.3) * np.cos(z / 3.1)
        + 0.4 * np.sin(z / 1.7 + 0.4 * y)
        + 0.3 * np.cos(y / 1.3 - z / 4.0)
    )


def test_the_frame_lies_where_the_central_pixel_looks():
    frame = frame_of_image(
        image([2000.0, 300.0, 100.0], [50.0, 5.0, -3.0]), RayCaster(CUBE), OPTIONS
    )
    np.testing.assert_allclose(frame.grid.center, [50.0, 5.0, -3.0], atol=1e-9)
    np.testing.assert_allclose(frame.normal, [1.0, 0.0, 0.0], atol=1e-12)
    assert frame.range == pytest.approx(np.linalg.norm([1950.0, 295.0, 103.0]))
    # The Sun stands half-way to +Y: at +X it is three hours before noon.
    assert frame.local_time_h == pytest.approx(9.0, abs=0.5)
    assert frame.emission_deg == pytest.approx(np.degrees(np.arctan2(np.hypot(295, 103), 1950)))
    assert frame.incidence_deg == pytest.approx(45.0)


def test_images_past_the_body_are_left_out():
    past = frame_of_image(image([2000.0, 0.0, 0.0], [0.0, 300.0, 0.0]), RayCaster(CUBE), OPTIONS)
    assert past == UnpairedImage("I1", Cause.OFF_BODY, "the central pixel misses the body")


@pytest.mark.parametrize(
    ("position", "sun", "reason"),
    [
        ([550.0, 1000.0, 0.0], [1.0, 0.0, 0.0], "the emission at the central pixel is 63 deg"),
        ([2000.0, 0.0, 0.0], [0.05, 1.0, 0.0], "the incidence at the central pixel is 87 deg"),
        ([2000.0, 0.0, 0.0], [-1.0, 0.0, 0.0], "the incidence at the central pixel is 180 deg"),
    ],
)
def test_oblique_ground_is_left_out_and_the_angle_reported(position, sun, reason):
    seen = image(position, [50.0, 0.0, 0.0], sun=sun)
    left_out = frame_of_image(seen, RayCaster(CUBE), OPTIONS)
    assert left_out == UnpairedImage("I1", Cause.OBLIQUE, left_out.reason)
    assert left_out.reason.startswith(reason)


def test_size_and_gsd_by_rule_are_those_of_bennu():
    assert pair_size(245.0, 0.35) == (100.0, 0.5)
    assert pair_size(244.8, 0.05) == (100.0, 0.5)
    # A small body with coarse maplets: enough cells to match, but no square that bends away.
    assert pair_size(75.0, 0.5) == (45.0, 0.5)
    assert pair_size(40.0, 0.75) == (24.0, 0.75)


def test_local_time_is_noon_under_the_sun():
    assert local_time(np.array([0.0, 9.0, 1.0]), np.array([0.0, 1.0, 0.0])) == pytest.approx(12.0)
    assert local_time(np.array([-9.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])) == pytest.approx(18.0)


def test_a_pair_finds_how_far_the_lidar_lies_from_spc():
    frame = frame_of_image(image([2000.0, 0.0, 0.0], [50.0, 0.0, 0.0]), RayCaster(CUBE), OPTIONS)
    grid = frame.grid
    node = grid.points(np.zeros(grid.shape))
    spc = Maplet("I1", grid, relief(node[..., 1], node[..., 2]))
    generator = np.random.default_rng(1)
    y, z = generator.uniform(-21.0, 21.0, (2, 60_000))
    shift = np.array([-0.4, 0.3, -0.2])
    surface = np.stack([50.0 + relief(y, z), y, z], axis=1) + shift
    returns = Returns(surface, np.full(len(y), 0.03), np.zeros(len(y), dtype=np.int32), ("S",))
    pair = make_pair(
        frame, spc, returns, PairSources("S", np.ones(1), np.eye(3)[None], np.ones(1)), OPTIONS
    )
    assert isinstance(pair, Pair)
    observed = pair_observations([pair, pair], "spc")
    np.testing.assert_allclose(observed.value[0], shift, atol=0.01)
    # The surface lies 0.4 m further along the beam than SPC has it.
    assert observed.epsilon()[0][0] == pytest.approx(0.4 / 1950.0, rel=0.03)
    assert abs(pair.relative_blur()) < 0.5
    assert isinstance(rematch(pair, OPTIONS, blur_cells=0.0), Pair)


def test_without_maplet_or_returns_there_is_no_pair():
    frame = frame_of_image(image([2000.0, 0.0, 0.0], [50.0, 0.0, 0.0]), RayCaster(CUBE), OPTIONS)
    unknown = Maplet("I1", frame.grid, np.full(frame.grid.shape, np.nan))
    none = Returns(np.empty((0, 3)), np.empty(0), np.empty(0, dtype=np.int32), ())
    assert make_pair(frame, unknown, none, SOURCES, OPTIONS).reason == "no maplet lies there"
    flat = Maplet("I1", frame.grid, np.zeros(frame.grid.shape))
    left_out = make_pair(frame, flat, none, SOURCES, OPTIONS)
    assert left_out.reason == "no return of that time lies there"
    assert left_out.cause == "no-data"


@pytest.mark.parametrize(
    ("what", "spc_side", "lidar_side"), [("maplets", 15, 41), ("returns", 41, 15)]
)
def test_a_square_that_one_of_the_two_hardly_covers_is_left_out(what, spc_side, lidar_side):
    frame = frame_of_image(image([2000.0, 0.0, 0.0], [50.0, 0.0, 0.0]), RayCaster(CUBE), OPTIONS)
    node = frame.grid.points(np.zeros(frame.grid.shape))
    height = relief(node[..., 1], node[..., 2])
    height[np.abs(frame.grid.offsets) > spc_side] = np.nan
    height[:, np.abs(frame.grid.offsets) > spc_side] = np.nan
    generator = np.random.default_rng(1)
    y, z = 0.5 * lidar_side * generator.uniform(-1.0, 1.0, (2, 40_000))
    points = np.stack([50.0 + relief(y, z), y, z], axis=1)
    returns = Returns(points, np.full(len(y), 0.03), np.zeros(len(y), dtype=np.int32), ("S",))
    left_out = make_pair(frame, Maplet("I1", frame.grid, height), returns, SOURCES, OPTIONS)
    assert isinstance(left_out, UnpairedImage)
    assert left_out.reason.startswith(f"{what} cover only 1")
    assert left_out.reason.endswith("% of the square")


def test_the_line_of_sight_is_that_of_the_returns():
    frame = frame_of_image(image([2000.0, 0.0, 0.0], [50.0, 0.0, 0.0]), RayCaster(CUBE), OPTIONS)
    moved = frame.with_station(np.array([1000.0, 950.0, 0.0]))
    np.testing.assert_allclose(moved.beam, [-1 / np.sqrt(2), -1 / np.sqrt(2), 0.0], atol=1e-12)
    assert moved.range == pytest.approx(950.0 * np.sqrt(2))
