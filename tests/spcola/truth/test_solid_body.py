"""Bodies that overhang: a closed mesh on any base, folded where boulders and cliffs stand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spcola.errors import InvalidValueError, SettingsError
from spcola.formats.shapes import read_shape
from spcola.grids import MapletGrid
from spcola.math import lattice
from spcola.shape import Mesh, RayCaster
from spcola.shape.icq import IcqShape, icq_directions
from spcola.truth.body import BOULDER, BodySettings, TruthBody
from spcola.truth.body.relief import PowerLaw
from spcola.truth.solid import FineSite, SolidBody, SolidSettings
from spcola.truth.solid.overhangs import Cliff, UndercutBoulder
from spcola.truth.solid.refining import SmoothMesh, refined

RADIUS = 40.0
PLAIN = SolidSettings(spacing=1.5, boulders=0, cliffs=0)
# A smooth sphere with regular ellipsoids on it, so that heights are known by formula.
REGULAR = replace(PLAIN, boulders=3, smallest=4.0, largest=8.0, reach_deg=140.0, roughness=0.0)
SPHERE = BodySettings.sphere(RADIUS)


@pytest.fixture(scope="module")
def body() -> SolidBody:
    return SolidBody(SPHERE, REGULAR)


def is_closed(facets: np.ndarray) -> bool:
    """Whether each edge belongs to two facets that run along it in opposite directions."""
    ends = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    there = ends[:, 0] * (facets.max() + 1) + ends[:, 1]
    back = ends[:, 1] * (facets.max() + 1) + ends[:, 0]
    return len(np.unique(there)) == len(there) and np.array_equal(np.sort(there), np.sort(back))


def test_a_curved_mesh_of_a_sphere_becomes_a_sphere() -> None:
    mesh = IcqShape(RADIUS * icq_directions(6), name="sphere").mesh()
    first = SmoothMesh(mesh.vertices, mesh.vertices / RADIUS, mesh.facets)
    for curved, worst in ((True, 0.017), (False, 1.5)):
        fine = refined(first, lambda middle: np.full(len(middle), 2.0), curved=curved)
        assert np.abs(np.linalg.norm(fine.vertices, axis=1) - RADIUS).max() < worst
        assert np.array_equal(fine.vertices[: len(mesh.vertices)], mesh.vertices)
        a, b, c = (fine.vertices[fine.facets[:, k]] for k in range(3))
        edges = np.concatenate([b - a, c - b, a - c])
        assert np.linalg.norm(edges, axis=1).max() <= 2.0
        assert is_closed(fine.facets)


def test_edges_are_short_only_where_asked_and_leave_no_gap() -> None:
    mesh = IcqShape(RADIUS * icq_directions(6), name="sphere").mesh()
    first = SmoothMesh(mesh.vertices, mesh.vertices / RADIUS, mesh.facets)
    fine = refined(first, lambda middle: np.where(middle[:, 0] > 30.0, 0.5, 8.0), curved=True)
    assert is_closed(fine.facets)
    a, b, c = (fine.vertices[fine.facets[:, k]] for k in range(3))
    assert (np.sum(np.cross(b - a, c - a) * a, axis=1) > 0).all()
    assert len(fine.facets) < 60_000
    ahead = a[:, 0] > 32.0
    assert np.linalg.norm(b - a, axis=1)[ahead].max() <= 0.5


def test_a_boulder_is_the_ellipsoid_and_overhangs(body: SolidBody) -> None:
    assert is_closed(body.surface_mesh.facets)
    assert len(body.overhangs) == 3
    for boulder in body.overhangs:
        assert isinstance(boulder, UndercutBoulder)
        patch, (a, b, c) = boulder.patch, boulder.semi_axes
        assert a >= b >= c
        grid = MapletGrid(patch.origin, patch.axes, patch.reach / 40.0, 40)
        steps = grid.offsets * grid.gsd
        x, y = np.meshgrid(steps, steps)
        inside = (x / a) ** 2 + (y / b) ** 2
        drop = np.sqrt(RADIUS**2 - x**2 - y**2) - RADIUS
        top = c * np.sqrt(np.maximum(1.0 - inside, 0.0)) - c * np.cos(np.radians(140.0))
        foot = np.sin(np.radians(140.0)) ** 2
        sheets = body.sheets(grid)
        # The ground bends away below the boulder, which bends with it.
        bend = patch.reach**2 / (2.0 * RADIUS)
        assert np.nanmax(np.abs(sheets[0] - top)[inside < 0.9]) < bend + 0.05
        over = (inside > foot + 0.1) & (inside < 0.9)
        assert np.isfinite(sheets[1][over]).all()
        assert np.abs(sheets[1] - drop)[over].max() < bend
        assert np.isnan(body.heights(grid)[over]).all()
        near = body.heights_near(grid, drop + 0.1)
        # A facet that bridges the foot may add a third.
        over &= np.isfinite(sheets).sum(axis=0) == 2
        assert np.array_equal(near[over], sheets[1][over])
        off_side = np.hypot(x, y) > 1.02 * patch.reach
        assert body.heights(grid)[off_side] == pytest.approx(drop[off_side], abs=0.04)


def test_the_radius_is_unknown_where_there_are_several(body: SolidBody) -> None:
    directions = lattice(40_000)
    radius, outermost = body.radius(directions), body.outermost_radius(directions)
    several = np.isnan(radius)
    assert 0.001 < several.mean() < 0.03
    assert np.array_equal(radius[~several], outermost[~several])
    expected = 0.0
    for boulder in body.overhangs:
        a, b, c = boulder.semi_axes
        equator = RADIUS - c * np.cos(np.radians(140.0))
        expected += np.pi * a * b * ((RADIUS / equator) ** 2 - np.sin(np.radians(140.0)) ** 2)
    assert several.mean() * 4 * np.pi * RADIUS**2 == pytest.approx(expected, rel=0.12)
    points = outermost[:, None] * directions
    for boulder in body.overhangs:
        patch = boulder.patch
        several &= np.linalg.norm(points - patch.origin, axis=1) > 2.0 * patch.reach
    assert not several.any()


def test_a_point_below_the_overhang_is_outside(body: SolidBody) -> None:
    patch, (a, _, c) = body.overhangs[0].patch, body.overhangs[0].semi_axes
    reach = np.radians(140.0)
    # Below the equator of the ellipsoid, next to its undercut side; and inside it.
    places = np.array([[0.92 * a, 0.0, 0.15 * c], [0.0, 0.0, -c * np.cos(reach)]])
    found = body.nearest(patch.origin + places @ patch.axes)
    assert found.distance[0] > 0.0
    assert found.distance[1] < -0.5 * c
    assert body.nearest(found.points).distance == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.norm(found.normals, axis=1) == pytest.approx(1.0)
    assert found.normals[0] @ patch.axes[0] > 0


def test_ground_under_an_overhang_is_hidden_from_above_and_seen_from_the_side(
    body: SolidBody,
) -> None:
    for boulder in body.overhangs:
        patch, (a, b, _) = boulder.patch, boulder.semi_axes
        around = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        # Between the foot (0.64 of the semi-axes) and the equator.
        x, y = 0.85 * a * np.cos(around), 0.85 * b * np.sin(around)
        from_below = patch.origin + np.stack([x, y, 0.02 + 0 * x], axis=1) @ patch.axes
        ground = body.nearest(from_below).points
        up = patch.axes[2]
        assert body.surface.occluded(ground, up).all()
        above = ground + 500.0 * up
        hits = body.first_hits(above, ground - above)
        assert (hits.distance < 500.0 - 0.2 * a).all()
        # From the side to which they lie, slightly above the curved horizon.
        side = np.stack([x, y, 0.25 * np.hypot(x, y)], axis=1) @ patch.axes
        assert not body.surface.occluded(ground, side).any()
        away = ground + 300.0 * side / np.linalg.norm(side, axis=1)[:, None]
        seen = body.first_hits(away, ground - away)
        assert seen.distance == pytest.approx(300.0, abs=1e-6)
        radius = np.linalg.norm(ground, axis=1)
        assert np.isnan(body.radius(ground)).all()
        assert (body.outermost_radius(ground) > radius + 0.2 * a).all()


def test_a_cliff_leans_over_the_ground_in_front_of_it() -> None:
    solid = replace(PLAIN, cliffs=1, cliff_length=20.0, cliff_height=4.0, cliff_overhang=2.5)
    body = SolidBody(SPHERE, solid)
    (cliff,) = body.overhangs
    assert isinstance(cliff, Cliff)
    assert is_closed(body.surface_mesh.facets)
    patch = cliff.patch
    grid = MapletGrid(patch.origin, patch.axes, 0.1, 40)
    sheets = body.sheets(grid)
    profile = np.isfinite(sheets).sum(axis=0)[:, 40]
    over = np.flatnonzero(profile == 2)
    steps = grid.offsets[over] * grid.gsd
    # The strip (y + o q(y)) folds between -0.58 m and -1.96 m: from the extremes of the cubic.
    assert steps.min() == pytest.approx(-1.95, abs=0.12)
    assert steps.max() == pytest.approx(-0.55, abs=0.12)
    middle = over[len(over) // 2]
    assert sheets[0][middle, 40] - sheets[1][middle, 40] > 2.0
    assert np.isnan(body.heights(grid)[middle, 40])


def test_the_body_is_the_same_again_and_another_with_another_seed() -> None:
    settings = BodySettings(seed=5, radius=30.0)
    solid = replace(REGULAR, spacing=2.0, roughness=0.1)
    one, again = SolidBody(settings, solid), SolidBody(settings, solid)
    assert one.fingerprint == again.fingerprint
    assert SolidBody(replace(settings, seed=6), solid).fingerprint != one.fingerprint
    assert SolidBody(settings, replace(solid, boulders=2)).fingerprint != one.fingerprint
    assert is_closed(one.surface_mesh.facets)
    flags = one.terrain(one.overhangs[0].patch.origin[None], smallest=2.0)
    assert flags[0] & BOULDER


def test_relief_is_that_of_the_settings() -> None:
    settings = BodySettings(seed=5, radius=30.0)
    body = SolidBody(settings, replace(PLAIN, spacing=1.0))
    directions = lattice(2000)
    apart = body.outermost_radius(directions) - super(SolidBody, body).radius(directions)
    # Relief along normals, not radii, and edges of up to 1 m.
    assert np.sqrt(np.mean(apart**2)) < 0.06
    flat = SolidBody(settings, replace(PLAIN, spacing=1.0, relief=0.0))
    assert np.std(flat.outermost_radius(directions) - body.outermost_radius(directions)) > 0.08


@pytest.mark.real_data
def test_a_given_base_is_kept(shared_data: Path) -> None:
    base = read_shape(shared_data / "bennu" / "g_12570mm_alt_obj_0000n00000_v014.obj")
    settings = BodySettings(seed=2, radius=base.mean_radius)
    solid = replace(PLAIN, spacing=7.0, relief=0.0)
    caster = RayCaster(base)
    flat = SolidBody(settings, replace(solid, curved=False), base=base)
    assert np.abs(caster.closest(flat.surface_mesh.vertices).distance).max() < 1e-9
    assert flat.surface_mesh.volume == pytest.approx(base.volume, rel=1e-12)
    curved = SolidBody(settings, solid, base=base)
    apart = curved.nearest(base.vertices).distance
    assert np.abs(apart).max() < 1e-9
    # Between its vertices the base is not known better than its edges curve.
    away = caster.closest(curved.surface_mesh.vertices).distance
    assert np.sqrt(np.mean(away**2)) < 0.2
    assert np.abs(away).max() < 2.0
    relief = SolidBody(settings, replace(solid, relief=1.0), base=base)
    away = caster.closest(relief.surface_mesh.vertices).distance
    assert 0.5 < np.sqrt(np.mean(away**2)) < 2.5
    assert is_closed(relief.surface_mesh.facets)


def test_a_base_that_is_no_body_is_refused() -> None:
    base = IcqShape(RADIUS * icq_directions(6), name="base").mesh()
    v, f = base.vertices, base.facets
    turned = f.copy()
    turned[7] = f[7, ::-1]
    for vertices, facets, message in (
        (v, f[1:], "base: is not closed: 3 edges"),
        (v, f[:, ::-1], "facets inward"),
        (v, turned, "face the other way than their neighbours, on 3 edges"),
        (v, np.vstack([f, f[:1]]), "3 edges of more than two facets"),
        (np.vstack([v, 0.3 * v]), np.vstack([f, f + len(v)]), "2 separate pieces"),
        (v + np.array([2.0 * RADIUS, 0.0, 0.0]), f, "does not have the origin inside"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            SolidBody(SPHERE, PLAIN, base=Mesh(vertices, facets, "base"))


def test_a_fine_site_has_rocks_and_albedo_at_its_scale() -> None:
    """Heights and albedo vary down to decimetres on the site, and the mesh stays closed."""
    settings = BodySettings(seed=3, radius=RADIUS, shortest=0.2, smallest_rock=0.2)
    site = FineSite(10.0, 40.0, diameter=4.0, spacing=0.15)
    body = SolidBody(settings, replace(PLAIN, sites=(site,)))
    assert is_closed(body.surface_mesh.facets)
    expected = body.solid.facets(RADIUS)
    assert len(body.surface_mesh.facets) == pytest.approx(expected, rel=0.5)
    place = body.outermost_radius(site.direction[None])[0] * site.direction
    corners = body.surface_mesh.vertices[body.surface_mesh.facets]
    away = np.sqrt(np.sum((corners - place) ** 2, axis=2)).max(axis=1)
    edges = np.sqrt(np.sum((corners - np.roll(corners, 1, axis=1)) ** 2, axis=2))
    # Relief stretches the edges of the smooth base.
    assert np.median(edges[away < 2.0]) < site.spacing
    assert np.median(edges[away > 12.0]) > 0.5
    fine = corners[away < 2.0].mean(axis=1)
    truth = TruthBody(settings)
    error = np.sqrt(np.sum(fine**2, axis=1)) - truth.radius(fine)
    assert np.sqrt(np.mean(error**2)) < 0.03
    albedo = body.albedo(fine) - TruthBody(replace(settings, shortest=1.2)).albedo(fine)
    assert albedo.std() > 0.01


@pytest.mark.real_data
def test_a_base_may_have_several_radii_itself(shared_data: Path) -> None:
    """The two lobes of 67P; a boulder on them is as undercut as on a sphere."""
    base = read_shape(shared_data / "rosetta_67p" / "navcam" / "67p-4k.obj")
    # Millions of pebbles, as on a small body, would hardly be seen at this spacing.
    settings = BodySettings(seed=1, radius=base.mean_radius, boulders=PowerLaw(1e4, 2.7, 4.0, 10.0))
    solid = replace(PLAIN, spacing=200.0, boulders=2, smallest=300.0, largest=400.0)
    body = SolidBody(settings, solid, base=base)
    assert is_closed(body.surface_mesh.facets)
    assert 0.02 < np.isnan(body.radius(lattice(5000))).mean() < 0.2
    assert body.surface_mesh.volume == pytest.approx(base.volume, rel=0.02)


def test_a_mesh_of_too_many_facets_is_refused_in_one_line() -> None:
    with pytest.raises(SettingsError, match=r"facets are too many.*larger spacing"):
        SolidBody(BodySettings(), replace(PLAIN, spacing=0.1))
