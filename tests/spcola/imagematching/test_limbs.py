"""Limbs: a sphere of known radius in an image, found from a shape that is smaller."""

from dataclasses import replace

import numpy as np
import pytest

from spcola.camera import Camera, SpcImage, ray
from spcola.imagematching.limbs import find_limb
from spcola.shape import Mesh, RayCaster

RADIUS, DISTANCE, SIDE = 100.0, 1000.0, 160
EYE = np.array([0.6, -0.5, 0.3]) / np.linalg.norm([0.6, -0.5, 0.3])
PIXEL_M = 2.0
FINER = 5


def sphere(radius):
    """A mesh whose facets are a degree wide."""
    north, east = np.radians(np.arange(-90, 91, 1.0)), np.radians(np.arange(0, 360, 1.0))
    lat, lon = np.meshgrid(north, east, indexing="ij")
    points = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    row, column = np.meshgrid(np.arange(len(north) - 1), np.arange(len(east)), indexing="ij")
    width = len(east)
    a, b = row * width + column, row * width + (column + 1) % width
    c, d = a + width, b + width
    facets = np.concatenate([np.stack(f, axis=-1).reshape(-1, 3) for f in ((a, b, d), (a, d, c))])
    return RayCaster(Mesh(radius * points.reshape(-1, 3), facets))


def state(sun):
    third = -EYE
    first = np.cross([0.0, 0.0, 1.0], third)
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(third, first), third])
    focal = 50.0
    per_mm = DISTANCE / (PIXEL_M * focal)
    matrix = np.array([[per_mm, 0.0, 0.0], [0.0, per_mm, 0.0]])
    camera = Camera(focal, np.full(2, 0.5 * (SIDE + 1)), matrix, SIDE, SIDE)
    return SpcImage(
        "SPHERE", "2020 JAN 01 00:00:00", camera, -DISTANCE * EYE, axes, sun / np.linalg.norm(sun)
    )


def photograph(sun, sky=20.0, noise=0.0):
    """A sphere of Lambert's law; each pixel is the mean of 25 lines of sight."""
    image = state(sun)
    sub = (np.arange(FINER) + 0.5) / FINER - 0.5
    pixel, line = np.meshgrid(*[(np.arange(1, SIDE + 1)[:, None] + sub).ravel()] * 2, indexing="xy")
    sight = ray(image, pixel.ravel(), line.ravel())
    along = sight @ image.position
    inside = along**2 - (DISTANCE**2 - RADIUS**2)
    met = inside > 0
    there = image.position + (-along - np.sqrt(np.where(met, inside, 0.0)))[:, None] * sight
    bright = np.where(met, np.maximum(there @ image.sun / RADIUS, 0.0), 0.0)
    mean = bright.reshape(SIDE, FINER, SIDE, FINER).mean(axis=(1, 3))
    pixels = sky + 5000.0 * mean + noise * np.random.default_rng(1).standard_normal(mean.shape)
    return replace(image, pixels=pixels)


@pytest.mark.parametrize("wrong", [-6.0, 0.0, 5.0])
def test_the_limb_is_that_of_the_image_not_of_the_shape(wrong):
    limb = find_limb(photograph(EYE + 0.5), sphere(RADIUS + wrong), reach_m=8.0)
    away = np.linalg.norm(limb.points, axis=1) - RADIUS
    assert len(limb) > 25
    assert abs(np.median(away)) < 0.2 * PIXEL_M
    # All errors, those of the mesh's facets too, are within a few sigmas.
    assert (np.abs(away) < 4.0 * limb.sigma).all()
    assert limb.sigma == pytest.approx(np.full(len(limb), 0.35 * PIXEL_M), rel=0.05)
    up = limb.points / np.linalg.norm(limb.points, axis=1)[:, None]
    assert np.sum(up * limb.normals, axis=1).min() > 0.99


def test_only_the_lit_limb_is_found():
    image = photograph(np.array([0.0, 0.0, 1.0]) + 0.2 * EYE, noise=10.0)
    limb = find_limb(image, sphere(RADIUS), reach_m=4.0)
    assert len(limb) > 20
    assert (limb.normals @ image.sun > 0.3).all()


def test_an_image_without_the_body_or_filled_by_it_has_none():
    image = photograph(EYE)
    dark = replace(image, pixels=np.full((SIDE, SIDE), 20.0))
    assert len(find_limb(dark, sphere(RADIUS), reach_m=4.0)) == 0
    away = replace(image, axes=image.axes * [[1.0], [-1.0], [-1.0]])
    assert len(find_limb(away, sphere(RADIUS), reach_m=4.0)) == 0
    assert len(find_limb(image, sphere(3.0 * RADIUS), reach_m=4.0)) == 0
