"""How coarse the facets of a mesh are, and what they miss of a sphere."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.shape import Mesh
from spcola.shape.icq import IcqShape, icq_directions

RADIUS, Q = 250.0, 64
SPHERE = IcqShape(RADIUS * icq_directions(Q)).mesh()


def test_the_side_of_facets_is_that_of_the_squares_of_a_grid():
    side = np.sqrt(4.0 * np.pi * RADIUS**2 / (6 * Q**2))
    assert SPHERE.facet_side == pytest.approx(side, rel=0.05)
    assert SPHERE.missed_relief == pytest.approx(0.1 * SPHERE.facet_side)


def test_chords_lie_below_a_sphere_by_their_sagitta():
    corners = SPHERE.corners
    middles = (corners[:, 0] + corners[:, 2]) / 2.0, (corners[:, 0] + corners[:, 1]) / 2.0
    below = [RADIUS - np.linalg.norm(middle, axis=1).mean() for middle in middles]
    # Two of the edges of a facet are sides of a square, one is its diagonal.
    assert min(below) < 1.3 * SPHERE.sagitta
    assert max(below) > 0.7 * SPHERE.sagitta


@pytest.mark.parametrize("pole", [[0.0, 0.0, 1.0], [0.6, -0.5, 0.62]])
def test_a_part_of_a_body_has_its_sagitta(pole):
    """Its volume is not that of the body."""
    near = SPHERE.corners.mean(axis=1) @ pole > 0.95 * RADIUS
    part = Mesh(
        SPHERE.vertices[SPHERE.facets[near]].reshape(-1, 3),
        np.arange(3 * near.sum()).reshape(-1, 3),
    )
    assert part.mean_radius < 0.8 * RADIUS
    assert part.sagitta == pytest.approx(SPHERE.sagitta, rel=0.2)
