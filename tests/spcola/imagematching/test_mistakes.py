"""States that contradict the shape: planted contradictions, and what mends them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.camera import Camera, SpcImage
from spcola.imagematching.frames.mistakes import BodyOutline, Mistake, ViewProblem
from spcola.shape import Mesh

RADIUS = 100.0


def ball() -> Mesh:
    """An octahedron, divided into a ball."""
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    facets = [(x, y, z) if (x + y + z) % 2 == 0 else (y, x, z)
              for x in (0, 1) for y in (2, 3) for z in (4, 5)]  # fmt: skip
    triangles = corners[np.array(facets)]
    for _ in range(3):
        a, b, c = triangles.transpose(1, 0, 2)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(part, axis=1) for part in parts])
    vertices = triangles.reshape(-1, 3)
    vertices = RADIUS * vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    return Mesh(vertices, np.arange(len(vertices)).reshape(-1, 3), "ball")


OUTLINE = BodyOutline.of_mesh(ball())
CAMERA = Camera(100.0, [50.5, 50.5], [[50, 0, 0], [0, 50, 0]], 100, 100)
PLACE = np.array([9_000.0, 4_000.0, -2_000.0])
AXES = (
    Rotation.from_rotvec([0.001, 0.002, 0.4]) * Rotation.align_vectors([[0, 0, 1.0]], [-PLACE])[0]
).as_matrix()
GOOD = SpcImage("A", "", CAMERA, -PLACE, AXES, np.array([0.8, 0.0, 0.6]))


def test_a_good_state_contradicts_nothing_and_near_the_ground_neither() -> None:
    assert OUTLINE.problem(GOOD) is None
    low = 1.03 * RADIUS / np.linalg.norm(PLACE)
    assert OUTLINE.problem(replace(GOOD, scobj=-low * PLACE)) is None


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"scobj": -0.001 * PLACE}, ViewProblem.INSIDE),
        ({"scobj": -1000.0 * PLACE}, ViewProblem.TINY),
        ({"scobj": PLACE}, ViewProblem.AWAY),
        ({"axes": np.diag([1, -1, -1]) @ AXES}, ViewProblem.AWAY),
        ({"sun": -PLACE / np.linalg.norm(PLACE)}, ViewProblem.NIGHT),
    ],
)
def test_planted_contradictions_are_found(change, problem) -> None:
    assert OUTLINE.problem(replace(GOOD, **change)) is problem
    assert problem.text


@pytest.mark.parametrize("mistake", Mistake)
def test_a_mistake_that_is_made_and_mended_is_none(mistake: Mistake) -> None:
    factor = {Mistake.KM_AS_M: 1e-3, Mistake.M_AS_KM: 1e3}.get(mistake)
    made = mistake.mended(GOOD) if factor is None else replace(GOOD, scobj=factor * GOOD.scobj)
    mended = mistake.mended(made)
    for name in ("scobj", "axes", "sun"):
        np.testing.assert_allclose(getattr(mended, name), getattr(GOOD, name), rtol=1e-12)
    assert mistake in OUTLINE.mistakes(made)
    assert mistake.text
