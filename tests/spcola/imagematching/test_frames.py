"""Whole frames against a shape: silhouettes by another way, planted offsets and orientations."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from spcola.camera import Camera, SpcImage, project_image
from spcola.imagematching.frames import (
    center_view,
    compare_frame,
    render_frame,
)
from spcola.imagematching.frames.compare import _correlations, silhouette_overlap
from spcola.shape import Mesh, RayCaster

SUN = np.array([0.6, -0.64, 0.48])
PLAIN = ([0.0] * 4, "owen", 125.2, 0.0085, 512)
APOLLO = [-0.006, -0.002, -1.3361854e-06, 5.2261757e-10, -5.0728336e-14, -5.4958195e-07,
          -4.608942e-11, 2.965907]  # fmt: skip


def rosetta():
    """Some pixels in the corners of 2048 × 2048."""
    scale = np.array([[1.0 / 2048.0 ** (i + j) for i in range(4)] for j in range(4)])
    random = np.random.default_rng(4).normal(scale=2.0, size=(2, 4, 4))
    small = np.triu(np.ones((4, 4)))[:, ::-1] * scale * random
    small[0, 0, 1] += 1.0
    small[1, 1, 0] += 1.0
    return [0.0135, 1023.5, 1023.5, *small.ravel()]


def transverse():
    moved = np.random.default_rng(5).normal(scale=1e-5, size=20)
    moved[[1, 12]] += 1.0
    return list(moved)


MODELS = [
    (rosetta(), "rosetta", 717.0, 0.0135, 2048),
    (transverse(), "transverse", 550.0, 0.014, 1024),
    PLAIN,
    ([2e-3, 1e-5, -1e-4, 2e-4], "owen", 125.2, 0.0085, 512),
    ([0.91, -14.5, 4.3e-3, 1.1e-3, -0.017, 0.1, -0.2, 0.3], "brown", 125.2, 0.0085, 512),
    (APOLLO, "hasselblad", 76.054, 0.2, 570),
    ([1e-3, -1e-5, 1e-8], "radial", 105.0, 0.012, 512),
    ([0.013, 1.0, -9.28e-9, 0.0], "hayabusa2", 121.1, 0.013, 512),
    ([-0.52, -0.22, 2.21e-05, 1.71e-04, 5.96e-05, 0.0, 0.0], "ocams", 125.2, 0.0085, 1024),
    (list(np.random.default_rng(1).normal(size=20) * 1e-5), "bicubic", 125.2, 0.0085, 512),
    ([1.81e-5], "lronac", 699.62, 0.07, 506),
]


def body(step: int = 60, radius: float = 250.0) -> Mesh:
    """A closed body with three lobes and a flattened pole."""
    lat = np.linspace(-np.pi / 2, np.pi / 2, step + 1)[1:-1]
    lon = np.arange(2 * step) * np.pi / step
    lat, lon = np.meshgrid(lat, lon, indexing="ij")
    reach = radius * (1 + 0.15 * np.cos(3 * lon) * np.cos(lat) ** 3 + 0.1 * np.sin(2 * lat))
    around = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    ring = np.stack(around, axis=-1) * reach[..., None]
    rows, columns = lat.shape
    vertices = np.vstack([ring.reshape(-1, 3), [[0, 0, -radius], [0, 0, radius]]])
    index = np.arange(rows * columns).reshape(rows, columns)
    east, south = np.roll(index, -1, axis=1), rows * columns
    facets = np.vstack([
        np.stack([index[:-1], east[:-1], east[1:]], axis=-1).reshape(-1, 3),
        np.stack([index[:-1], east[1:], index[1:]], axis=-1).reshape(-1, 3),
        np.stack([np.full(columns, south), east[0], index[0]], axis=-1),
        np.stack([np.full(columns, south + 1), index[-1], east[-1]], axis=-1),
    ])  # fmt: skip
    return Mesh(vertices, facets, "lobes")


@cache
def caster():
    """The body, made by the first test and not when tests are collected."""
    return RayCaster(body())


def image_of(coefficients, model, focal, pitch, size, *, sun=SUN):
    """The body over 60 % of the frame, off its centre."""
    lens = Camera(
        focal, [size / 2 + 0.5] * 2, [[1 / pitch, 0, 0], [0, 1 / pitch, 0]], size, size, model,
        coefficients,
    )  # fmt: skip
    half = size * pitch / 2 / focal
    away = np.array([0.5, -0.7, 0.5]) / np.linalg.norm([0.5, -0.7, 0.5])
    place = away * caster().radius / (0.6 * half)
    looking = Rotation.align_vectors([[0.05 * half, -0.1 * half, 1.0]], [-place])[0]
    axes = (Rotation.from_rotvec([0, 0, 0.7]) * looking).as_matrix()
    return SpcImage("A", "2019-03-03T00:00:00", lens, -place, axes, sun / np.linalg.norm(sun))


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m[1])
def test_silhouette_is_that_of_projected_ground(model):
    image = image_of(*model)
    size = image.camera.width
    step = size // 256
    # Forward: points of the surface; the rendering goes backward along rays.
    rng = np.random.default_rng(1)
    corners = caster().mesh.vertices[caster().mesh.facets]
    weight = np.sort(rng.random((25, len(corners), 2)), axis=-1)
    shares = np.diff(weight, axis=-1, prepend=0.0, append=1.0)
    points = np.einsum("nfk,fkx->nfx", shares, corners).reshape(-1, 3)
    pixel, line = project_image(image, points)
    cells = size // step
    places = np.floor((np.stack([line, pixel]) - 0.5) / step).astype(int)
    inside = ((places >= 0) & (places < cells)).all(axis=0)
    seen = np.zeros((cells, cells), dtype=bool)
    seen[tuple(places[:, inside])] = True
    rendered = render_frame(caster(), image, step=step)
    assert silhouette_overlap(seen, rendered.body) >= 0.97
    # The frame's side matters: another orientation does not fit.
    assert silhouette_overlap(seen[:, ::-1], rendered.body) < 0.93


@pytest.mark.parametrize("offset", [(0.0, 0.0), (5.0, -7.0), (-11.4, 2.7), (1.0, 0.5)])
def test_a_planted_offset_is_found(offset):
    image = image_of(*PLAIN)
    camera = replace(image.camera, center=image.camera.center + np.array(offset))
    moved = render_frame(caster(), replace(image, camera=camera)).brightness
    dn = np.rint(100.0 * moved + 5.0).astype(np.uint16)
    found = compare_frame(dn, render_frame(caster(), image, step=2), lowest=12, reach_px=20)
    # A parabola through correlations at whole cells is off by up to 0.4 pixel here.
    np.testing.assert_allclose(found.offset, offset, atol=0.12)
    assert found.correlation > 0.98
    assert found.overlap > 0.97
    assert found.given <= found.correlation
    if np.hypot(*offset) > 2.0:
        assert found.overlap_given < found.overlap


def test_a_mirrored_frame_correlates_less():
    image = image_of(*PLAIN)
    frame = render_frame(caster(), image)
    dn = np.rint(200.0 * frame.brightness).astype(np.uint8)
    coarse = render_frame(caster(), image, step=4)
    scores = [
        compare_frame(np.ascontiguousarray(one), coarse, lowest=5, reach_px=32).correlation
        for one in (dn, dn[:, ::-1], dn[::-1], dn.T, dn[::-1, ::-1])
    ]
    assert scores[0] > 0.99
    # The body is nearly symmetric about a line of this frame.
    assert max(scores[1:]) < scores[0] - 0.02


def test_correlations_are_those_of_the_overlap():
    rng = np.random.default_rng(2)
    one, other = rng.random((2, 20, 24))
    found = _correlations(one, other, 3)
    assert found.shape == (7, 7)
    for down, right in ((0, 0), (2, -3), (-1, 3)):
        a = one[max(down, 0) : 20 + min(down, 0), max(right, 0) : 24 + min(right, 0)]
        b = other[max(-down, 0) : 20 + min(-down, 0), max(-right, 0) : 24 + min(-right, 0)]
        wanted = np.corrcoef(a.ravel(), b.ravel())[0, 1]
        assert found[down + 3, right + 3] == pytest.approx(wanted, abs=1e-12)


def test_uniform_frames_have_no_correlation_and_no_silhouette():
    frame = render_frame(caster(), image_of(*PLAIN), step=8)
    found = compare_frame(np.zeros((512, 512), np.uint8), frame, lowest=1, reach_px=16)
    assert found.correlation == -1.0
    assert found.overlap == 0.0
    empty = np.zeros((4, 4), dtype=bool)
    assert np.isnan(silhouette_overlap(empty, empty))


def test_shadow_is_cast():
    behind = image_of(*PLAIN, sun=np.array([-0.5, 0.7, -0.5]))
    frame = render_frame(caster(), behind, step=4)
    assert frame.body.any()
    # From behind only a sickle is lit.
    assert np.count_nonzero(frame.brightness) < 0.1 * np.count_nonzero(frame.body)


def test_center_of_the_frame_on_a_sphere():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(6000, 3))
    points *= 100.0 / np.linalg.norm(points, axis=1, keepdims=True)
    hull = ConvexHull(points)
    facets = hull.simplices.copy()
    corner = points[facets]
    inward = np.einsum(
        "ij,ij->i", np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), corner[:, 0]
    ) < 0  # fmt: skip
    facets[inward] = facets[inward][:, ::-1]
    caster = RayCaster(Mesh(points, facets, "ball"))
    lens = Camera(100.0, [50.5, 50.5], [[50.0, 0, 0], [0, 50.0, 0]], 100, 100)
    sun = np.array([np.sin(0.5), 0.0, np.cos(0.5)])
    axes = np.diag([1.0, -1.0, -1.0])
    # The boresight passes the body's centre at 30 m.
    image = SpcImage("A", "2019-03-03T00:00:00", lens, [-30.0, 0, -1000.0], axes, sun)
    view = center_view(caster, image)
    height = np.sqrt(100.0**2 - 30.0**2)
    assert view.range_m == pytest.approx(1000.0 - height, abs=0.5)
    assert view.resolution_m == pytest.approx((1000.0 - height) / 5000.0, rel=1e-3)
    assert view.phase == pytest.approx(0.5, abs=1e-9)
    assert view.emission == pytest.approx(np.arcsin(0.3), abs=0.03)
    assert view.incidence == pytest.approx(0.5 - np.arcsin(0.3), abs=0.03)
    aside = center_view(caster, SpcImage("A", "x", lens, [-500.0, 0, -1000.0], axes, sun))
    assert np.isnan(aside.emission)
    assert aside.range_m == pytest.approx(np.hypot(500.0, 1000.0))
