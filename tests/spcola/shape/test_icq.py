"""ICQ shapes: topology, triangles, and a sphere as a limit."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.errors import InvalidValueError
from spcola.shape import Mesh
from spcola.shape.icq import IcqShape, as_icq, distinct_vertices, icq_directions, shared_labels


def sphere(q: int, radius: float = 250.0) -> IcqShape:
    return IcqShape(radius * icq_directions(q))


@pytest.mark.parametrize("q", [1, 2, 3, 8])
def test_labels_name_as_many_vertices_as_the_format_says(q):
    number, first = distinct_vertices(q)
    assert len(number) == 6 * (q + 1) ** 2
    assert len(first) == 6 * q**2 + 2
    assert number.max() == 6 * q**2 + 1
    np.testing.assert_array_equal(number[first], np.arange(len(first)))
    assert np.all(np.diff(first) > 0)
    labels = np.bincount(number)
    # Eight corners have three labels, the rest of the twelve edges two.
    assert (labels == 3).sum() == 8
    assert (labels == 2).sum() == 12 * (q - 1)


def test_faces_look_to_their_axes():
    middles = icq_directions(2)[:, 1, 1]
    axes = [[0, 0, 1], [0, -1, 0], [-1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, -1]]
    np.testing.assert_array_equal(middles, axes)


def test_labels_of_one_vertex_are_one_point_of_the_sphere():
    one, other = shared_labels(5)
    points = icq_directions(5).reshape(-1, 3)
    np.testing.assert_allclose(points[one], points[other], atol=1e-15)


@pytest.mark.parametrize("distinct", [True, False])
def test_the_mesh_is_closed_faces_outward_and_tends_to_the_sphere(distinct):
    mesh = sphere(24).mesh(distinct=distinct)
    assert len(mesh.facets) == 12 * 24**2
    assert np.all(np.einsum("ij,ij->i", mesh.normals, mesh.corners.mean(axis=1)) > 0)
    ball = 4.0 / 3.0 * np.pi * 250.0**3
    # A chord lies below its arc: the volume is missed by the square of the facets' size.
    missing = [1.0 - sphere(q).mesh(distinct=distinct).volume / ball for q in (12, 24)]
    assert missing[0] / missing[1] == pytest.approx(4.0, rel=0.02)
    assert np.abs(mesh.area_vectors.sum(axis=0)).max() < 1e-6


def test_every_edge_of_the_distinct_mesh_belongs_to_two_facets():
    facets = sphere(6).mesh().facets
    edges = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    forward = {tuple(edge) for edge in edges.tolist()}
    assert len(forward) == len(edges)
    assert {(b, a) for a, b in forward} == forward


def test_a_quad_is_split_by_the_rule_of_cross_products():
    rng = np.random.default_rng(7)
    q = 5
    vertices = icq_directions(q).copy()
    vertices[:, 1:-1, 1:-1] *= 1.0 + 0.2 * rng.random((6, q - 1, q - 1, 1))
    shape = IcqShape(vertices)
    facets = {frozenset(facet) for facet in shape.mesh(distinct=False).facets.tolist()}
    number = np.arange(6 * (q + 1) ** 2).reshape(6, q + 1, q + 1)
    for f, j, i in np.ndindex(6, q, q):
        v = shape.vertices[f]
        along = np.linalg.norm(np.cross(v[j, i], v[j + 1, i + 1]))
        across = np.linalg.norm(np.cross(v[j, i + 1], v[j + 1, i]))
        a, b = number[f, j, i], number[f, j, i + 1]
        c, d = number[f, j + 1, i], number[f, j + 1, i + 1]
        pair = {(a, b, d), (a, c, d)} if along <= across else {(a, b, c), (b, c, d)}
        assert {frozenset(int(x) for x in facet) for facet in pair} <= facets


def test_labels_of_one_vertex_that_lie_far_apart_are_refused():
    vertices = 250.0 * icq_directions(4)
    vertices[0, 4, 2] *= 1.02  # v(2,4,1) is v(2,0,2)
    with pytest.raises(InvalidValueError, match=r"\(2, 4, 1\) and \(2, 0, 2\) name one vertex"):
        IcqShape(vertices)
    # A shape with its rows and columns exchanged, or with two faces in each other's place.
    for wrong in (
        250.0 * icq_directions(16).transpose(0, 2, 1, 3),
        250.0 * icq_directions(16)[[1, 0, 2, 3, 4, 5]],
    ):
        with pytest.raises(InvalidValueError, match="differ by more than 1%"):
            IcqShape(wrong)


def apart(q=64, radius=290.0):
    """A shape whose faces were made one by one: 360 of 780 pairs of labels differ, by ≤ 0.89 m.

    Second the labels that were moved, outward.
    """
    vertices = np.ascontiguousarray(radius * icq_directions(q))
    one, other = shared_labels(q)
    points = vertices.reshape(-1, 3)
    # Apart from corners a label is in one pair only.
    twice = np.bincount(np.concatenate([one, other]), minlength=len(points)) > 1
    inner = one[~twice[one] & ~twice[other]]
    chosen = np.random.default_rng(4).permutation(inner)[:360]
    points[chosen] *= 1.0 + np.linspace(0.1, 0.89, 360)[:, None] / radius
    return vertices, chosen


def test_labels_that_differ_are_kept_apart_and_reported():
    vertices, _ = apart()
    shape = IcqShape(vertices)
    np.testing.assert_array_equal(shape.vertices, vertices)
    gaps = shape.gaps
    assert (gaps.shared, gaps.differing) == (780, 360)
    assert gaps.max_m == pytest.approx(0.89)
    assert gaps.rms_m == pytest.approx(np.sqrt(np.mean(np.linspace(0.1, 0.89, 360) ** 2)))
    assert sphere(64).gaps.differing == 0
    assert str(gaps).startswith("360 of 780 pairs of labels that name one vertex differ")


def test_labels_that_differ_are_merged_by_the_rule_that_is_asked_for():
    vertices, chosen = apart()
    shape, points = IcqShape(vertices), vertices.reshape(-1, 3)
    one, other = shared_labels(64)
    mean, first = shape.mesh(), shape.mesh(edges="first")
    number, label = distinct_vertices(64)
    np.testing.assert_array_equal(first.vertices, points[label])
    for pair in np.flatnonzero(np.isin(one, chosen))[::20]:
        middle = (points[one[pair]] + points[other[pair]]) / 2.0
        np.testing.assert_allclose(mean.vertices[number[one[pair]]], middle)
    # All others are where they were, to the bit.
    same = np.ones(len(label), dtype=bool)
    same[number[chosen]] = False
    np.testing.assert_array_equal(mean.vertices[same], points[label][same])
    assert "their mean" in mean.remark
    assert "first label" in first.remark
    assert sphere(8).mesh().remark == ""
    with pytest.raises(InvalidValueError, match="360 of 780"):
        shape.mesh(edges="refuse")
    edge = np.sort(mean.facets[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert np.all(np.unique(edge, axis=0, return_counts=True)[1] == 2)


@pytest.mark.parametrize("q", [1, 2, 32])
def test_a_mesh_in_the_order_of_an_icq_is_known_as_one(q):
    shape = IcqShape(250.0 * icq_directions(q))
    mesh = shape.mesh(distinct=False)
    found = as_icq(mesh)
    assert found is not None
    assert found.q == q
    np.testing.assert_array_equal(found.vertices, shape.vertices)
    assert as_icq(shape.mesh()) is None
    other_order = np.roll(mesh.vertices, 1, axis=0)
    assert as_icq(Mesh(other_order, np.array([[0, 1, 2]]))) is None


def test_arrays_that_are_no_icq_are_refused():
    with pytest.raises(InvalidValueError, match="no ICQ"):
        IcqShape(np.ones((6, 3, 4, 3)))
    with pytest.raises(InvalidValueError, match="not finite"):
        IcqShape(np.full((6, 3, 3, 3), np.nan))
    with pytest.raises(InvalidValueError, match="layer"):
        IcqShape(icq_directions(2), np.ones((6, 2, 2)))
