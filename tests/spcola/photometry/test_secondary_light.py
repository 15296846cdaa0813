"""Ground in the shade, lit by a wall that the Sun lights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from photographs import Painted

from spcola.grids import Maplet, MapletGrid
from spcola.heights.slopes import slopes_of
from spcola.photometry.functions import lambert
from spcola.photometry.photoclinometry import (
    Fit,
    HeightConstraint,
    PhotoclinometryOptions,
    solve_photoclinometry,
)
from spcola.photometry.secondary_light import secondary_light
from spcola.shape import Mesh, RayCaster

GRID = MapletGrid.facing([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.5, 20)
# Low on one side: a screen there leaves the ground in the shade, and lets light pass to a wall.
SUN = np.array([-1.0, 0.0, 0.3]) / np.hypot(1.0, 0.3)
FOOT, TOP, WIDE = 25.0, 30.0, 40.0


def main_direction(light):
    """Mean direction of the light, body-fixed."""
    mean = light.irradiance.mean(axis=(1, 2)) @ light.directions
    return mean / np.linalg.norm(mean)


def turned(points, quarter):
    """Points turned about Uz by quarters of a turn."""
    angle = 0.5 * np.pi * quarter
    cosine, sine = np.cos(angle), np.sin(angle)
    return points @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def wall(quarter):
    """A wall that faces the ground from afar, and its facets."""
    y, z = np.meshgrid(np.linspace(-WIDE, WIDE, 21), np.linspace(0.0, TOP, 11))
    points = np.stack([np.full(y.shape, FOOT), y, z], axis=-1).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(10), np.arange(20), indexing="ij")
    a = (row * 21 + column).ravel()
    # Its outer side is towards the ground.
    facets = np.concatenate(
        [np.stack([a, a + 21, a + 1], -1), np.stack([a + 1, a + 21, a + 22], -1)]
    )
    return turned(points, quarter), facets


def floor():
    """The ground as the shape has it, flat."""
    corners = 50.0 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def screen(quarter):
    """What stands between ground and Sun, above what sees the wall."""
    corners = np.array([[-20.0, -15, 0.1], [-20, 15, 0.1], [-20, 15, 11.0], [-20, -15, 11.0]])
    return turned(corners, quarter), np.array([[0, 1, 2], [0, 2, 3]])


def joined(*parts):
    first, vertices, facets = 0, [], []
    for points, corners in parts:
        vertices.append(points)
        facets.append(corners + first)
        first += len(points)
    return RayCaster(Mesh(np.concatenate(vertices), np.concatenate(facets)))


def from_wall(points, normals, quarter, sun):
    """Brightness (N,) of ground by the light of a wall: sums over patches of a metre.

    Cosines at both ends over the squared distance, Lambert's law.
    """
    y, z = np.meshgrid(np.arange(-WIDE, WIDE) + 0.5, np.arange(0.0, TOP) + 0.5)
    patches = np.stack([np.full(y.shape, FOOT), y, z], axis=-1).reshape(-1, 3)
    patches = turned(patches, quarter)
    outward = turned(np.array([-1.0, 0.0, 0.0]), quarter)
    lit = max(float(outward @ sun), 0.0)
    total = np.zeros(len(points))
    for chunk in np.array_split(np.arange(len(points)), len(points) // 500 + 1):
        away = patches - points[chunk, None]
        square = np.sum(away**2, axis=-1)
        cosines = np.maximum(np.sum(away * normals[chunk, None], axis=-1), 0.0) * -(away @ outward)
        total[chunk] = lit * np.sum(np.maximum(cosines, 0.0) / square**2, axis=1)
    return total


class Shaded(Painted):
    """Waves in the shade of a screen, in the light of a wall; no albedo."""

    quarter = 0

    def _brightness(self, eye, beam, sun):
        along = self._along(eye, beam)
        points = eye + along[..., None] * beam
        x, y, _ = np.moveaxis(points, -1, 0)
        tx, ty = self.slopes(x, y)
        normals = np.stack([-tx, -ty, np.ones_like(tx)], axis=-1)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        found = from_wall(points.reshape(-1, 3), normals.reshape(-1, 3), self.quarter, sun)
        return found.reshape(x.shape)


def sun_of(quarter):
    return turned(SUN, quarter)


@pytest.fixture(scope="module")
def shaded():
    """Ground, images by name, and their light."""
    ground, images, lights = Shaded(GRID), [], {}
    flat = Maplet("FLAT", GRID, np.zeros(GRID.shape))
    for quarter in (0, 1, 2, 3):
        ground.quarter = quarter
        name = f"I{quarter}"
        image = ground.photograph(
            name, [0.1, 0.2, 1.0], sun_of(quarter), pixel=0.5, size=60, samples=1
        )
        shape = joined(wall(quarter), floor(), screen(quarter))
        lights[name] = secondary_light(flat, image, shape, lambert)
        images.append((image, shape))
    return ground, images, lights


def test_it_is_the_sum_over_the_lit_wall(shaded):
    """Brightness of flat and tilted ground, against a sum over patches of the wall."""
    light = shaded[2]["I0"]
    directions, irradiance = light.on_cells(GRID)
    steps = (GRID.offsets[1:] - 0.5) * GRID.gsd
    x, y = np.meshgrid(steps, steps)
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    frame = GRID.axes
    found, expected = [], []
    for tilt in ([0.0, 0.0], [0.2, 0.0], [-0.2, 0.0], [0.0, 0.2]):
        normal = np.array([*tilt, 1.0]) / np.linalg.norm([*tilt, 1.0])
        cosine = np.maximum(directions @ (frame @ normal), 0.0)
        found.append(np.tensordot(cosine, irradiance, 1).ravel())
        body = points @ frame
        expected.append(from_wall(body, np.broadcast_to(normal, body.shape), 0, sun_of(0)))
    ratio = np.array(found) / np.array(expected)
    assert np.std(ratio / ratio.mean()) < 0.02
    assert main_direction(light)[0] > 0.8


def test_turned_twice_it_is_the_same(shaded):
    light = shaded[2]["I0"]
    assert main_direction(light.turned())[:2] == pytest.approx(-main_direction(light)[:2])
    np.testing.assert_allclose(light.turned().turned().directions, light.directions, atol=1e-12)


def test_ground_in_sunlight_has_none(shaded):
    image, shape = shaded[1][0]
    flat = Maplet("FLAT", GRID, np.zeros(GRID.shape))
    high = replace(image, sun=np.array([0.0, 0.3, 1.0]) / np.hypot(0.3, 1.0))
    assert secondary_light(flat, high, shape, lambert) is None


def test_relief_in_the_shade_is_solved(shaded):
    """From flat ground, with one height known, in the light of four walls."""
    ground, images, lights = shaded
    truth = ground.heights()
    known = np.full(truth.shape, np.nan)
    known[20, 20] = truth[20, 20]
    states = {image.name: 1e-14 * np.eye(6) for image, _ in images}
    found = solve_photoclinometry(
        Maplet("FLAT", GRID, np.zeros(GRID.shape)),
        [image for image, _ in images],
        states,
        constraints=[HeightConstraint.of_sigma("one", known, 1e-3)],
        beyond=[joined(*(screen(q) for q in range(4)))],
        secondary=lights,
        options=PhotoclinometryOptions(function=lambert, shift_sigma_px=1e-3, slope_sigma=1.0),
    )
    assert all(fit.fit is Fit.USED and fit.correlation > 0.98 for fit in found.images)
    error = (found.maplet.height - truth)[3:-3, 3:-3]
    assert np.std(error) < 0.08 * np.std(truth)
    wrong, right = (np.array(slopes_of(h, GRID.gsd)) for h in (error, truth[3:-3, 3:-3]))
    assert np.std(wrong) < 0.08 * np.std(right)
    assert (found.directions == 2).mean() > 0.9
