from __future__ import annotations

import numpy as np
import pytest

from spcola.camera import Camera, SpcImage
from spcola.grids import Maplet, MapletGrid
from spcola.photometry import slope_variance
from spcola.photometry.functions import lambert, lunar_lambert
from spcola.photometry.shadows import cast_shadow

GRID = MapletGrid.facing([80.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, 10)
DISTANCE = 1000.0


def direction(incidence, azimuth):
    """Unit vector, body-fixed, by degrees from Uz and from Ux towards Uy."""
    i, a = np.radians([incidence, azimuth])
    return np.array([np.sin(i) * np.cos(a), np.sin(i) * np.sin(a), np.cos(i)]) @ GRID.axes


def image(sun, eye=None, *, name="A", distance=DISTANCE, pixels=None, thresholds=(0, 65535)):
    """An image of 100 × 100 pixels of 0.25 m from `distance` 1000 m, looking at the centre."""
    toward = GRID.uz if eye is None else eye
    position = GRID.center + distance * toward
    across = np.cross(GRID.uy, -toward)
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(-toward, across), -toward])
    camera = Camera(100.0, [50.5, 50.5], [[40.0, 0.0, 0.0], [0.0, 40.0, 0.0]], 100, 100)
    state = {"pixels": pixels, "thresholds": thresholds}
    return SpcImage(name, "2019 JAN 01 00:00:00.000", camera, -position, axes, sun, **state)


def flat(slope_x=0.0, slope_y=0.0):
    y, x = np.mgrid[-10:11, -10:11] * GRID.gsd
    return Maplet("FLAT01", GRID, slope_x * x + slope_y * y)


@pytest.mark.parametrize("incidence", [20.0, 45.0, 70.0])
def test_three_suns_around_flat_lambertian_ground(incidence):
    """Brightness over its mean is 1 − tan i (tx cos a + ty sin a): variance 2 / (3 tan² i)."""
    suns = [image(direction(incidence, azimuth)) for azimuth in (10.0, 130.0, 250.0)]
    found = slope_variance(flat(), suns, function=lambert)
    expected = 2.0 / (3.0 * np.tan(np.radians(incidence)) ** 2)
    np.testing.assert_allclose(found.along_x, expected, rtol=1e-6)
    np.testing.assert_allclose(found.along_y, expected, rtol=1e-6)
    assert np.all(found.images == 3)


def test_variance_is_that_of_slopes_solved_from_noisy_brightnesses():
    suns = [direction(i, a) for i, a in ((40, 0), (50, 100), (30, 200), (60, 300), (45, 20))]
    eyes = [direction(i, a) for i, a in ((5, 0), (20, 90), (10, 180), (25, 270), (15, 45))]
    images = [image(sun, eye) for sun, eye in zip(suns, eyes, strict=True)]
    truth = np.array([0.2, -0.1])
    found = slope_variance(flat(*truth), images)
    axes = [np.stack([GRID.axes @ each for each in group]) for group in (suns, eyes)]

    def brightness(slopes, albedo):
        normal = np.array([-slopes[0], -slopes[1], 1.0]) / np.sqrt(1.0 + slopes @ slopes)
        phase = np.arccos(np.sum(axes[0] * axes[1], axis=1))
        return albedo * lunar_lambert(axes[0] @ normal, axes[1] @ normal, phase)

    mean = brightness(truth, 1.0)
    step, (east, north) = 1e-6, np.eye(2)
    design = np.stack(
        [
            (brightness(truth + step * east, 1.0) - mean) / step,
            (brightness(truth + step * north, 1.0) - mean) / step,
            mean,
        ],
        axis=1,
    )
    rng = np.random.default_rng(3)
    noise = 1e-3 * mean * rng.normal(size=(20000, 5))
    weights = 1.0 / mean
    solved = np.linalg.lstsq(design * weights[:, None], (noise * weights).T, rcond=None)[0]
    # The camera is near: over the grid its direction turns by a degree. The middle is exact.
    spread = solved[:2].std(axis=1) / 1e-3
    assert np.sqrt(found.along_x[10, 10]) == pytest.approx(spread[0], rel=0.02)
    assert np.sqrt(found.along_y[10, 10]) == pytest.approx(spread[1], rel=0.02)


def test_too_few_or_like_images_define_no_slope():
    ground = flat()
    two = [image(direction(40.0, 0.0)), image(direction(40.0, 90.0))]
    assert not slope_variance(ground, two).defined.any()
    alike = [image(direction(40.0, 30.0)) for _ in range(5)]
    assert not slope_variance(ground, alike).defined.any()
    assert not slope_variance(ground, []).defined.any()


def test_what_no_sun_lights_and_no_camera_sees_has_no_slope():
    suns = [direction(60.0, azimuth) for azimuth in (-20.0, 0.0, 20.0)]
    assert slope_variance(flat(), [image(sun) for sun in suns]).defined.all()
    # Turned away by 45°, the Sun stands 15° below the ground's horizon.
    assert not slope_variance(flat(1.0), [image(sun) for sun in suns]).defined.any()
    aside = [image(sun, name="B") for sun in suns]
    moved = MapletGrid(GRID.center + 40.0 * GRID.uy, GRID.axes, GRID.gsd, GRID.half_size)
    off_side = Maplet("OFFSIDE", moved, np.zeros(GRID.shape))
    assert not slope_variance(off_side, aside).defined.any()
    assert slope_variance(off_side, aside, framed=False).defined.all()


def test_shadow_and_saturation_are_recognised_by_the_pixels():
    pixels = np.full((100, 100), 1000, dtype=np.uint16)
    pixels[:, :50] = 10
    pixels[:20, :] = 4095
    suns = [direction(40.0, azimuth) for azimuth in (0.0, 120.0, 240.0)]
    images = [image(sun, pixels=pixels, thresholds=(50, 4095)) for sun in suns]
    found = slope_variance(flat(), images)
    all_lit = slope_variance(flat(), [image(sun) for sun in suns])
    assert all_lit.defined.all()
    assert 0.4 < found.defined.mean() < 0.6
    np.testing.assert_allclose(
        found.along_x[found.defined], all_lit.along_x[found.defined], rtol=0.02
    )


def test_information_of_a_pixel_is_divided_among_its_points():
    suns = [direction(40.0, azimuth) for azimuth in (0.0, 120.0, 240.0)]
    # 0.25 m a pixel at 1 km: half a grid step there, two grid steps at 4 km.
    near, far, further = (
        slope_variance(flat(), [image(sun, distance=d) for sun in suns], function=lambert)
        for d in (1000.0, 4000.0, 11000.0)
    )
    np.testing.assert_allclose(far.along_x, 4.0 * near.along_x, rtol=0.01)
    assert not further.defined.any()


def test_a_wall_casts_a_shadow_of_its_height_over_the_tangent_of_the_sun():
    height = np.zeros((21, 61))
    height[:, 40] = 3.0
    sun = np.array([np.cos(0.3), 0.0, np.sin(0.3)])
    dark = cast_shadow(height, sun)
    # Bilinear flanks, one step wide, add nothing beyond the ray over the top.
    length = 3.0 / np.tan(0.3)
    assert dark[5:-5, 40 - int(length) : 40].all()
    assert not dark[:, : 40 - int(length) - 1].any()
    assert not dark[:, 40:].any()
    assert not cast_shadow(height, np.array([0.0, 0.0, 1.0])).any()


def test_a_low_sun_darkens_all_that_is_known():
    height = np.zeros((5, 5))
    height[2, 2] = np.nan
    dark = cast_shadow(height, np.array([1.0, 0.0, -0.1]))
    assert np.array_equal(dark, np.isfinite(height))
    assert not cast_shadow(height, np.array([0.9, 0.0, 0.4])).any()
