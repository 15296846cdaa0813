"""A small sphere over a large one: what it hides, shadows and overhangs, by formula."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from spcola.camera import ray
from spcola.grids import MapletGrid
from spcola.math import lattice
from spcola.shape import Mesh, RayCaster
from spcola.shape.icq import IcqShape, icq_directions
from spcola.truth.body import BodySettings, TruthBody
from spcola.truth.imaging import ImageSettings, render_image
from spcola.truth.solid import MeshSurface
from spcola.truth.solid.sheets import nearest_sheet, sheets_of, single_sheet

from .test_rendering import an_image

GROUND, BALL = 60.0, 6.0
AWAY = np.array([0.6, -0.64, 0.48])
CENTER = (GROUND + 0.5 * BALL) * AWAY
Q = 120
# The facets lie this far below the spheres at most: two faces' widths, squared, over 8 radii.
SAG, BALL_SAG = ((2.0 * r / Q) ** 2 / (4.0 * r) for r in (GROUND, BALL))


def sphere(radius: float, q: int) -> Mesh:
    return IcqShape(radius * icq_directions(q), name="sphere").mesh()


def joined(one: Mesh, other: Mesh, offset: np.ndarray) -> Mesh:
    vertices = np.concatenate([one.vertices, other.vertices + offset])
    return Mesh(vertices, np.concatenate([one.facets, other.facets + len(one.vertices)]))


@cache
def surface():
    """The spheres, made by the first test and not when tests are collected."""
    return MeshSurface(RayCaster(joined(sphere(GROUND, Q), sphere(BALL, Q), CENTER)))


def ball_in_the_way(points: np.ndarray, toward: np.ndarray, radius: float) -> np.ndarray:
    """Whether a ball of `radius` about CENTER stands between points and a direction (or place)."""
    to_center = CENTER - points
    ahead = np.sum(to_center * toward, axis=-1)
    across = np.sum(to_center**2, axis=-1) - ahead**2
    return (ahead > 0) & (across < radius**2)


def test_the_shadow_of_a_ball_ends_where_the_formula_says() -> None:
    sun = np.array([0.96, 0.0, 0.28])
    points = GROUND * (1.0 - 1e-5) * lattice(60_000)
    hits = surface().cast(2.0 * points, -points)
    ground = np.abs(np.linalg.norm(hits.points, axis=1) - GROUND) < 2 * SAG
    day = hits.points @ sun > 3.0
    points = hits.points[ground & day]
    dark = surface().occluded(points, sun)
    inner, outer = (ball_in_the_way(points, sun, BALL + d) for d in (-0.03, 0.03))
    assert inner.sum() > 80
    assert dark[inner].all()
    assert not dark[~outer].any()


def test_a_camera_sees_no_ground_behind_the_ball() -> None:
    camera = 400.0 * np.array([0.8, -0.6, 0.0])
    points = GROUND * lattice(60_000)
    points = points[np.linalg.norm(points - CENTER, axis=1) > BALL + 0.05]
    beams = points - camera
    distance = np.linalg.norm(beams, axis=1)
    hits = surface().cast(camera, beams)
    facing = points @ camera / GROUND > GROUND + 4.0
    seen = hits.distance > distance - 0.05
    toward = -beams / distance[:, None]
    inner, outer = (ball_in_the_way(points, toward, BALL + d) for d in (-0.03, 0.03))
    assert (inner & facing).sum() > 50
    assert not seen[inner & facing].any()
    assert seen[facing & ~outer].all()
    assert not seen[points @ camera / GROUND < GROUND - 1.0].any()


def test_an_image_shows_the_limb_of_the_ball_and_its_shadow() -> None:
    image = an_image(detector=240)
    settings = ImageSettings(noise=False, bits=16)
    body = TruthBody(BodySettings.sphere(GROUND))
    got = render_image(
        surface(), body, image, settings=settings, generator=np.random.default_rng(0)
    )
    line, pixel = np.indices(got.hit.shape) + 1.0
    beams = ray(image, pixel.ravel(), line.ravel())
    start = image.position
    apart = {
        name: np.linalg.norm(np.cross(center - start, beams), axis=1) - radius
        for name, center, radius in (("ground", np.zeros(3), GROUND), ("ball", CENTER, BALL))
    }
    outside = np.minimum(apart["ground"], apart["ball"]).reshape(got.hit.shape)
    assert got.hit[outside < -0.05].all()
    assert not got.hit[outside > 0.01].any()
    points = start + got.distance[..., None] * beams.reshape(*got.hit.shape, 3)
    on_ball = got.hit & (np.linalg.norm(points - CENTER, axis=-1) < BALL + 0.01)
    assert on_ball[(apart["ball"] < -0.05).reshape(got.hit.shape)].all()
    ground = got.hit & ~on_ball & (points @ image.sun > 3.0)
    shadow = ball_in_the_way(points, image.sun, BALL - 0.03)
    assert (ground & shadow).sum() > 30
    assert (got.iof[ground & shadow] == 0).all()
    assert (got.iof[ground & ~ball_in_the_way(points, image.sun, BALL + 0.03)] > 0).all()


def test_sheets_above_a_place_are_all_found_and_never_guessed() -> None:
    axes = np.linalg.qr(np.column_stack([AWAY, np.eye(3)[:, :2]]))[0].T
    axes = np.stack([axes[1], np.cross(AWAY, axes[1]), AWAY])
    grid = MapletGrid(GROUND * AWAY, axes, 0.5, 16)
    sheets = sheets_of(surface().caster, grid)
    steps = 0.5 * np.arange(-16, 17)
    away = np.hypot(*np.meshgrid(steps, steps))
    below = np.sqrt(GROUND**2 - away**2) - GROUND
    # The ball meets the ground on a ring of radius 5.2 m and is 6 m wide: between, it overhangs.
    ring = (away > 5.3) & (away < 5.9)
    assert ring.sum() > 30
    assert np.isfinite(sheets[1][ring]).all()
    assert np.isnan(single_sheet(sheets)[ring]).all()
    top = np.sqrt(np.maximum(BALL**2 - away**2, 0.0)) + 0.5 * BALL
    assert sheets[0][ring] == pytest.approx(top[ring], abs=0.08)
    assert sheets[1][ring] == pytest.approx(below[ring], abs=2 * SAG)
    outside = away > BALL + 0.01
    assert single_sheet(sheets)[outside] == pytest.approx(below[outside], abs=2 * SAG)
    near = nearest_sheet(sheets, below + 0.3)
    assert near[ring] == pytest.approx(below[ring], abs=2 * SAG)
    middle = nearest_sheet(sheets, 0.5 * (below + top))
    assert np.isnan(middle[ring]).all()
    assert np.isnan(nearest_sheet(sheets, np.full(grid.shape, np.nan))[ring]).all()


def test_closest_points_are_those_of_the_spheres_with_sign() -> None:
    caster = RayCaster(sphere(GROUND, Q))
    rng = np.random.default_rng(3)
    points = lattice(2000) * rng.uniform(0.7, 1.4, (2000, 1)) * GROUND
    found = caster.closest(points)
    assert found.distance == pytest.approx(np.linalg.norm(points, axis=1) - GROUND, abs=2 * SAG)
    foot = GROUND * points / np.linalg.norm(points, axis=1)[:, None]
    assert np.abs(found.points - foot).max() < 0.7
    corners = caster.mesh.corners[found.facet]
    away = np.linalg.norm(points[:, None] - corners, axis=2).min(axis=1)
    assert (np.abs(found.distance) <= away + 1e-12).all()
    # At vertices and edges facets meet: the sign is that of the side.
    vertices = caster.mesh.vertices
    assert caster.closest(1.001 * vertices).distance == pytest.approx(0.001 * GROUND, rel=1e-6)
    assert (caster.closest(0.999 * vertices).distance < 0).all()
