"""FormU of residuals that are planted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.truth.assessment.formal import formal_uncertainty
from spcola.camera import Camera, ImagePoint, SpcImage, project_image
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid

PIXEL = 1e-4
CAMERA = Camera(100.0, [512.5, 512.5], [[100.0, 0, 0], [0, 100.0, 0]], 1024, 1024)


def grid(y: float, gsd: float = 0.5) -> MapletGrid:
    return MapletGrid.facing([75.0, y, 0.0], [1.0, 0.0, 0.0], gsd, 49)


def image(name: str, distance: float, points: dict[str, tuple[MapletGrid, float]]) -> SpcImage:
    """Look along −X from (75 + `distance`, 0, 0); each point is measured so many pixels off."""
    axes = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    seen = SpcImage(
        name, "2019-07-01T00:00:00", CAMERA, [-75.0 - distance, 0, 0], axes, [1.0, 0.0, 0.0]
    )
    landmarks = []
    for landmark, (there, off) in points.items():
        pixel, line = project_image(seen, there.center)
        landmarks.append(ImagePoint(landmark, float(pixel) + 0.6 * off, float(line) - 0.8 * off))
    return replace(seen, landmarks=tuple(landmarks))


def test_residuals_are_pixels_times_their_size_on_the_ground() -> None:
    assert pytest.approx(CAMERA.pixel_angle) == PIXEL
    found = formal_uncertainty({"A": grid(0.0)}, [image("I", 1000.0, {"A": (grid(0.0), 0.5)})])
    assert found.formu == pytest.approx(0.5 * PIXEL * 1000.0, rel=1e-6)
    assert found.residual_pixels == pytest.approx(0.5, rel=1e-6)
    assert (found.maplets, found.observations) == (1, 1)


def test_it_is_the_rms_of_maplets_and_not_of_observations() -> None:
    a, b = grid(0.0), grid(3.0)
    images = [image(f"I{k}", 1000.0, {"A": (a, 1.0)}) for k in range(9)]
    images.append(image("J", 1000.0, {"A": (a, 1.0), "B": (b, 3.0)}))
    found = formal_uncertainty({"A": a, "B": b}, images)
    assert found.formu == pytest.approx(0.1 * np.sqrt((1.0 + 9.0) / 2.0), rel=1e-4)
    assert found.observations == 11
    assert 0.1 < found.share_80 < 0.3


def test_only_the_finest_maplets_count_and_no_star() -> None:
    fine, coarse = grid(0.0), grid(3.0, gsd=1.0)
    seen = image("I", 1000.0, {"A": (fine, 0.5), "C": (coarse, 9.0)})
    starred = replace(
        image("J", 1000.0, {"A": (fine, 7.0)}),
        landmarks=(ImagePoint("A", 1.0, 1.0, deweighted=True),),
    )
    found = formal_uncertainty({"A": fine, "C": coarse}, [seen, starred])
    assert found.formu == pytest.approx(0.05, rel=1e-5)
    assert found.gsd == 0.5
    assert found.observations == 1


def test_a_landmark_behind_the_camera_is_refused() -> None:
    seen = image("I", 1000.0, {"A": (grid(0.0), 0.5)})
    turned = replace(seen, axes=np.diag([1.0, -1.0, -1.0]) @ seen.axes)
    with pytest.raises(InvalidValueError, match="A, which lies behind"):
        formal_uncertainty({"A": grid(0.0)}, [turned])


def test_without_maplets_there_is_none_and_without_measurements_it_is_unknown() -> None:
    assert formal_uncertainty({}, []) is None
    found = formal_uncertainty({"A": grid(0.0)}, [image("I", 1000.0, {})])
    assert np.isnan(found.formu)
    assert found.maplets == 0
