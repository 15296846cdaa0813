"""Images that show a maplet: predicted where the camera sees its centre."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.camera import Camera, SpcImage, project_image
from spcola.grids import MapletGrid
from spcola.imagematching import ChoiceOptions, Pictures
from spcola.math import lattice
from spcola.shape import Mesh, RayCaster

GROUND = MapletGrid.facing([50.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, 10)


def image_from(name: str, toward: list[float], sun: list[float] | None = None) -> SpcImage:
    """An image of the ground from 500 m, with pixels of 0.5 m."""
    away = np.array(toward) / np.linalg.norm(toward)
    across = np.cross([0.0, 0.0, 1.0], -away)
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(-away, across), -away])
    camera = Camera(100.0, [200.5, 200.5], [[10.0, 0, 0], [0, 10.0, 0]], 400, 400)
    light = np.array(toward if sun is None else sun)
    return SpcImage(
        name, "", camera, axes=axes, scobj=-(GROUND.center + 500.0 * away),
        sun=light / np.linalg.norm(light),
    )  # fmt: skip


def wall(distance: float) -> RayCaster:
    """A wall across the way to the east."""
    corners = [[40, distance, -60], [400, distance, -60], [400, distance, 60], [40, distance, 60]]
    return RayCaster(Mesh(np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]])))


def test_the_centre_is_where_the_camera_sees_it() -> None:
    images = [image_from(f"I{k}", [1.0, 0.2 * k, 0.1]) for k in range(3)]
    found = Pictures(images).of(GROUND)
    assert [one.name for one in found] == ["I0", "I1", "I2"]
    for one, image in zip(found, images, strict=True):
        place = [float(x) for x in project_image(image, GROUND.center)]
        assert (one.pixel, one.line) == pytest.approx(place, abs=0.0051)


def test_what_faces_away_is_dark_or_hidden_is_left_out() -> None:
    images = [
        image_from("BEHIND", [-1.0, 0.0, 0.1]),
        image_from("DARK", [1.0, 0.0, 0.1], sun=[-1.0, 0.0, 0.0]),
        image_from("EAST", [1.0, 0.8, 0.1]),
        image_from("WEST", [1.0, -0.8, 0.1]),
    ]
    assert [one.name for one in Pictures(images).of(GROUND)] == ["EAST", "WEST"]
    assert [one.name for one in Pictures(images, wall(20.0)).of(GROUND)] == ["WEST"]
    assert Pictures([]).of(GROUND) == ()


def test_of_many_images_the_most_informative_are_kept() -> None:
    ways = [way for way in np.asarray(lattice(400)) if way[0] > 0.8]
    images = [image_from(f"I{k:03d}", list(way)) for k, way in enumerate(ways)]
    found = Pictures(images, options=ChoiceOptions(most=5)).of(GROUND)
    assert len(found) == 5
    assert [one.name for one in found] == sorted(one.name for one in found)
