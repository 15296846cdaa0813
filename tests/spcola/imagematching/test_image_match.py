from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spcola.imagematching.image_match import ImageMatchOptions, match_image
from spcola.photometry import ortho_rectify, render_view, view_of
from spcola.photometry.functions import lambert

LIGHT = [0.5, 0.2, 0.8]


def matched(waves, image, *, shift=(0.0, 0.0), height=None, **options):
    """Match with the ground displaced by `shift` (x, y) metres."""
    grid = waves.grid
    moved = grid.center - shift[0] * grid.ux - shift[1] * grid.uy
    view = view_of(
        image, replace(grid, center=moved), waves.heights() if height is None else height
    )
    rendered = render_view(view, function=lambert)
    return match_image(ortho_rectify(image, view), rendered, options=ImageMatchOptions(**options))


@pytest.fixture(scope="module", params=[0.2, 0.5, 1.0])
def photographed(request, waves):
    """A photograph with pixels of so many metres."""
    return waves.photograph("A", [0.3, -0.2, 1.0], LIGHT, pixel=request.param, size=180)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.31, -0.17), (-1.2, 0.9)])
def test_a_planted_shift_is_recovered(waves, photographed, shift):
    found = matched(waves, photographed, shift=shift)
    assert found.reason == ""
    np.testing.assert_allclose(found.shift * waves.grid.gsd, shift, atol=0.012)
    assert found.correlation > 0.95
    assert np.sqrt(np.diag(found.covariance)).max() < 0.05


def test_the_covariance_is_that_of_many_matches(waves):
    """Height errors correlated over cells: as white noise they would give too small a sigma."""
    image = waves.photograph("A", [0.2, 0.1, 1.0], LIGHT, pixel=0.5)
    rng, pulls = np.random.default_rng(3), []
    for _ in range(40):
        noise = np.cumsum(rng.normal(size=waves.grid.shape), axis=1) * 0.02
        noise -= noise.mean(axis=1, keepdims=True)
        found = matched(waves, image, height=waves.heights() + noise, min_correlation=0.2)
        assert found.usable, found.reason
        pulls.append(found.shift / np.sqrt(np.diag(found.covariance)))
    width = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert ((width > 0.5) & (width < 1.6)).all(), width


def test_what_cannot_be_matched_says_why(waves):
    image = waves.photograph("A", [0.3, -0.2, 1.0], LIGHT, pixel=0.5)
    assert (
        "edge of the capture range" in matched(waves, image, shift=(1.6, 0), capture_cells=3).reason
    )
    flat = matched(waves, image, height=np.zeros(waves.grid.shape))
    assert not flat.usable
    assert np.isnan(flat.shift).all()
    dark = replace(image, thresholds=(60000, 65000))
    assert "0 lit points" in matched(waves, dark).reason
    even = replace(image, pixels=np.full(image.pixels.shape, 5000))
    assert "no texture" in matched(waves, even).reason
    other = matched(waves, image, height=waves.heights()[::-1, ::-1])
    assert not other.usable


def test_shadows_are_left_out(waves):
    """A wall whose shadow is longer than that of its heights does not pull the match."""
    image = waves.photograph("A", [0.0, 0.0, 1.0], LIGHT, pixel=0.5)
    dark = image.pixels.copy()
    dark[:, 80:86] = 20
    found = matched(waves, replace(image, pixels=dark))
    np.testing.assert_allclose(found.shift, 0.0, atol=0.02)
    assert found.points < waves.grid.size**2 - 5 * waves.grid.size


def test_convex_ground_is_not_seen_inward(cap):
    """Blurred on the grid by one footprint, it would be: by 0.006 pixels at sin e = 1."""
    outward = []
    for turn in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        toward = [0.7 * np.cos(turn), 0.7 * np.sin(turn), 0.7]
        sun = [0.5 * np.cos(turn + 2.0), 0.5 * np.sin(turn + 2.0), 0.9]
        image = cap.photograph("A", toward, sun, pixel=0.9, samples=4, size=60)
        view = view_of(image, cap.grid, cap.heights())
        found = match_image(ortho_rectify(image, view), render_view(view, function=lambert))
        assert found.reason == ""
        up = image.axes[:2] @ cap.grid.uz
        outward.append(up @ (view.footprint @ found.shift) / (up @ up))
    assert abs(np.mean(outward)) < 0.002
