"""Rendered images: geometry, shadow and brightness of a sphere by formula; the detector."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from spcola.camera import Camera, SpcImage, project_image, ray
from spcola.errors import SettingsError
from spcola.formats.images import read_fits_image, read_image_data
from spcola.photometry.functions import lunar_lambert
from spcola.truth.body import BodySettings, TruthBody
from spcola.truth.campaign.cameras import framing_camera, looking
from spcola.truth.imaging import ImageSettings, render_image, write_image
from spcola.truth.imaging.rendering import Rendered, expose
from spcola.truth.sampled import SampledSurface

RADIUS, DISTANCE = 60.0, 2400.0
DIRECTION = np.array([0.6, -0.64, 0.48])
SUN = np.array([0.96, 0.0, 0.28])
BODY = TruthBody(BodySettings.sphere(RADIUS))
EXACT = ImageSettings(noise=False, bits=16)


@cache
def surface() -> SampledSurface:
    """The body's surface, made by the first test and not when tests are collected."""
    return SampledSurface(BODY, 0.5)


def an_image(detector: int = 200, camera: Camera | None = None) -> SpcImage:
    """A sphere that takes two thirds of the frame of 70 mrad, seen at 38° of phase."""
    camera = camera or framing_camera("MapCam", detector)
    axes = looking(DISTANCE * DIRECTION, np.zeros(3))
    return SpcImage("A1", "2019 JUL 01 00:00:00.000", camera, -DISTANCE * DIRECTION, axes, SUN)


def rendered(image: SpcImage, settings: ImageSettings = EXACT, seed: int = 0) -> Rendered:
    generator = np.random.default_rng(seed)
    return render_image(surface(), BODY, image, settings=settings, generator=generator)


def beams_of(image: SpcImage) -> np.ndarray:
    lines, pixels = np.mgrid[1 : image.camera.height + 1, 1 : image.camera.width + 1]
    return ray(image, pixels.astype(float), lines.astype(float))


def test_distance_incidence_and_emission_of_a_sphere() -> None:
    image = an_image()
    found, beams = rendered(image), beams_of(image)
    closest = -(beams @ image.position)
    half = RADIUS**2 - (image.position @ image.position - closest**2)
    np.testing.assert_array_equal(found.hit, half > 0)
    expected = closest - np.sqrt(np.where(half > 0, half, np.nan))
    np.testing.assert_allclose(found.distance, expected, rtol=0, atol=1e-6)
    normals = (image.position + expected[..., None] * beams) / RADIUS
    # Angles of 32 bits; cosines are flat where the angle is 0.
    np.testing.assert_allclose(np.cos(found.incidence), normals @ SUN, atol=1e-6)
    towards = -np.sum(normals * beams, axis=-1)
    np.testing.assert_allclose(np.cos(found.emission), towards, atol=3e-6)


def test_the_disc_has_the_size_that_geometry_says() -> None:
    image = an_image(400)
    per_tangent = image.camera.focal_length_mm * image.camera.k_matrix[0, 0]
    limb = per_tangent * np.tan(np.arcsin(RADIUS / (DISTANCE)))
    assert rendered(image).hit.sum() == pytest.approx(np.pi * limb**2, rel=1e-3)


def test_the_sun_shines_up_to_the_terminator() -> None:
    found = rendered(an_image())
    cosine = np.cos(found.incidence)
    dip = np.sqrt(2 * 0.01 * surface().spacing / RADIUS) + 1e-3
    assert found.lit[found.hit & (cosine > 1e-6)].all()
    assert not found.lit[~found.hit | (cosine < -dip)].any()
    assert (found.iof[~found.lit] == 0).all()
    share = (1.0 + DIRECTION @ SUN) / 2.0  # of the disc of a far sphere
    assert found.lit.sum() / found.hit.sum() == pytest.approx(share, abs=0.02)


def test_brightness_by_formula() -> None:
    image = an_image()
    found = rendered(image)
    phase = np.arccos(-beams_of(image) @ SUN)
    cosines = np.cos([found.incidence, found.emission])
    albedo = BODY.settings.mean_albedo
    expected = albedo * lunar_lambert(*cosines, phase)[found.lit]
    clear = cosines[1][found.lit] > 0.05
    np.testing.assert_allclose(found.iof[found.lit][clear], expected[clear], rtol=1e-5, atol=5e-8)
    scale = 0.7 * 65535 / 0.04
    whole = np.rint(np.minimum(scale * found.iof, 65535))
    np.testing.assert_array_equal(found.dn, whole)
    assert found.dn.dtype == np.uint16


def test_every_pixel_sees_what_projects_into_it_with_distortion_too() -> None:
    plain = framing_camera("MapCam", 64)
    k_matrix = plain.k_matrix + np.array([[0.0, 0.05, 0.0], [0.03, 0.0, 0.0]])
    bent = Camera(
        plain.focal_length_mm, plain.center, k_matrix, 64, 48, "owen", [2e-4, -1e-6, 1e-4, -5e-5]
    )
    for camera in (plain, bent):
        image = an_image(camera=camera)
        found = rendered(image)
        points = image.position + found.distance[..., None] * beams_of(image)
        pixel, line = project_image(image, points[found.hit])
        lines, pixels = np.nonzero(found.hit)
        np.testing.assert_allclose(pixel, pixels + 1, atol=1e-8)
        np.testing.assert_allclose(line, lines + 1, atol=1e-8)
    assert not np.array_equal(rendered(an_image(64)).hit[:48], found.hit)


def test_cast_shadows_are_those_of_the_body_itself() -> None:
    """Ground that faces the Sun but lies dark is behind something, seen from the Sun."""
    body = TruthBody(BodySettings(seed=2, radius=60.0))
    surface = SampledSurface(body, 0.2)
    image = an_image(100)
    found = render_image(surface, body, image, settings=EXACT, generator=np.random.default_rng(0))
    facing = found.hit & (found.incidence < np.radians(75))
    shaded = facing & ~found.lit
    assert shaded.sum() > 10
    points = image.position + found.distance[..., None] * beams_of(image)
    # Lifted, so that the difference of both surfaces hides none: at the foot of a boulder that
    # lifts some out of its shadow.
    for which, least, most in ((facing & found.lit, 0.0, 0.003), (shaded, 0.75, 1.0)):
        start = points[which] * (1.0 + 0.04 / RADIUS)
        met = body.cast(start, np.broadcast_to(SUN, start.shape))
        assert least <= np.isfinite(met[:, 0]).mean() <= most


@pytest.mark.parametrize("count", [5, 16])
def test_more_rays_do_not_shift_the_image(count: int) -> None:
    image, line = an_image(60), np.arange(60)
    middles = []
    for settings in (EXACT, replace(EXACT, rays_per_pixel=count)):
        light = rendered(image, settings).iof.astype(float)
        middles.append([light.sum(axis=k) @ line / light.sum() for k in (0, 1)])
    np.testing.assert_allclose(middles[1], middles[0], atol=0.03)


def test_more_rays_fill_the_limb_by_its_share() -> None:
    image = an_image(60)
    one, many = (
        rendered(image, replace(EXACT, rays_per_pixel=count, photometry="lambert"))
        for count in (1, 40)
    )
    np.testing.assert_array_equal(one.distance, many.distance)
    edge = np.abs(many.iof - one.iof)
    inside = one.lit & (one.emission < np.radians(50)) & (one.incidence < np.radians(60))
    assert edge[inside].max() < 5e-4
    partly = ~one.hit & (many.iof > 0)
    assert partly.sum() > 20
    # Lambert's sphere has the whole brightness 2/3 · albedo · (sin α + (π − α) cos α)/π · area.
    phase = np.arccos(DIRECTION @ SUN)
    integral = 2 / 3 * (np.sin(phase) + (np.pi - phase) * np.cos(phase)) / np.pi
    per_tangent = image.camera.focal_length_mm * image.camera.k_matrix[0, 0]
    area = np.pi * (per_tangent * np.tan(np.arcsin(RADIUS / (DISTANCE)))) ** 2
    expected = BODY.settings.mean_albedo * integral * area
    assert many.iof.sum() == pytest.approx(expected, rel=0.03)


def test_point_spread_keeps_the_light_and_blurs_the_limb() -> None:
    image = an_image(100)
    sharp, soft = rendered(image), rendered(image, replace(EXACT, psf_sigma=1.5))
    assert soft.iof.sum() == pytest.approx(sharp.iof.sum(), rel=1e-4)
    assert np.abs(np.diff(soft.iof)).max() < 0.4 * np.abs(np.diff(sharp.iof)).max()
    np.testing.assert_array_equal(soft.distance, sharp.distance)


def test_noise_is_that_of_the_electrons() -> None:
    settings = ImageSettings(bits=14, full_well=20_000.0, read_noise=30.0)
    iof = np.full((500, 500), 0.03, dtype=np.float32)
    numbers = expose(iof, settings, np.random.default_rng(1)).astype(float)
    per_electron = 16383 / 20_000
    mean = 0.7 * 16383 * 0.03 / 0.04
    sigma = per_electron * np.sqrt(mean / per_electron + 30.0**2)
    assert numbers.mean() == pytest.approx(mean, abs=4 * sigma / 500)
    # Rounding to whole numbers adds a twelfth.
    assert numbers.std() == pytest.approx(np.hypot(sigma, 12**-0.5), rel=0.006)


@pytest.mark.parametrize("bits", [8, 12, 14, 16])
def test_numbers_end_with_the_bits(bits: int) -> None:
    settings = ImageSettings(bits=bits, noise=False)
    dn = expose(np.array([[0.0, 0.04, 0.1]], dtype=np.float32), settings, np.random.default_rng(0))
    np.testing.assert_array_equal(dn, [[0, np.rint(0.7 * (2**bits - 1)), 2**bits - 1]])
    assert dn.dtype == (np.uint8 if bits == 8 else np.uint16)
    noisy = expose(np.zeros((50, 50), np.float32), ImageSettings(), np.random.default_rng(0))
    assert noisy.min() == 0


def test_the_same_seed_gives_the_same_image() -> None:
    image = an_image(100)
    first, again, other = (rendered(image, ImageSettings(), seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.dn, again.dn)
    assert not np.array_equal(first.dn, other.dn)
    np.testing.assert_array_equal(first.iof, other.iof)


def test_files_of_an_image_are_read_back(tmp_path: Path) -> None:
    image, settings = an_image(50), ImageSettings()
    found = rendered(image, settings)
    dat, fits = write_image(tmp_path, "A1", found, image, settings=settings)
    assert (dat.name, fits.name) == ("A1.DAT", "A1.fits")
    np.testing.assert_array_equal(read_image_data(dat, 50, 50), found.dn)
    back = read_fits_image(fits)
    np.testing.assert_array_equal(back.pixels, found.dn)
    np.testing.assert_allclose(back.scobj, image.scobj, rtol=1e-14)
    with pytest.raises(SettingsError, match="tiff is none of dat, fits"):
        write_image(tmp_path, "A2", found, image, formats=("dat", "tiff"))
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"bits": 10}, "bits"),
        ({"rays_per_pixel": 0}, "rays"),
        ({"psf_sigma": -1.0}, "point spread"),
        ({"read_noise": -1.0}, "read noise"),
        ({"exposure_iof": 0.0}, "exposure"),
        ({"exposure_share": 1.5}, "exposure"),
        ({"full_well": 0.0}, "exposure"),
        ({"photometry": "moonish"}, "photometric"),
    ],
)
def test_settings_out_of_range_are_refused(changes: dict, name: str) -> None:
    with pytest.raises(SettingsError, match=name):
        ImageSettings(**changes)
