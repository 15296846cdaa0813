"""States of images by fits of the rendered shape: planted errors come back."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.camera import Camera, SpcImage, project_image, rotate_axes
from spcola.errors import InvalidValueError, SettingsError
from spcola.imagematching.frames import compare_frame, render_frame
from spcola.imagematching.frames.fitting import FrameFitOptions, fit_frame
from spcola.photometry.functions import photometric_function
from spcola.shape import Mesh, RayCaster
from spcola.shape.icq import IcqShape, icq_directions

SIZE, RADIUS = 192, 250.0
LENS = Camera(100.0, [SIZE / 2 + 0.5] * 2, [[60.0, 0, 0], [0, 60.0, 0]], SIZE, SIZE)
MINNAERT = photometric_function("minnaert k=0.7")


def body(rough: float) -> Mesh:
    """A lumpy body; `rough` is the amplitude of relief that a coarse shape does not have."""
    rng = np.random.default_rng(3)
    ways = icq_directions(32)
    reach = np.ones(ways.shape[:-1])
    for wave, size in ((3.0, 0.08), (7.0, 0.03), (20.0, rough), (33.0, rough)):
        for _ in range(4):
            along = rng.normal(size=3)
            along *= wave / np.linalg.norm(along)
            reach += size / 2.0 * np.cos(ways @ along + rng.uniform(0.0, 6.0))
    return IcqShape(RADIUS * reach[..., None] * ways).mesh()


@cache
def casters() -> tuple[RayCaster, RayCaster]:
    """Of the true body, and of the shape that is known."""
    return RayCaster(body(0.004)), RayCaster(body(0.0))


def photographed(caster: RayCaster, number: int) -> SpcImage:
    """An image with noise of 1 %, from another side each."""
    rng = np.random.default_rng([number, 1])
    away = rng.normal(size=3)
    away *= 2.2 * RADIUS * 100.0 * 60.0 / SIZE / np.linalg.norm(away) * 1.4
    looking = Rotation.align_vectors([[0, 0, 1.0]], [-away])[0]
    axes = (Rotation.from_rotvec([0.004, -0.003, number]) * looking).as_matrix()
    sun = away / np.linalg.norm(away) + 0.9 * axes[0]
    image = SpcImage(
        "A", "2019-03-03T00:00:00", LENS, -away, axes, sun / np.linalg.norm(sun), (100, 65535)
    )
    seen = render_frame(caster, image, function=MINNAERT).brightness
    noisy = 20000.0 * seen + rng.normal(size=seen.shape) * 200.0 * (seen > 0.0)
    return replace(image, pixels=np.clip(noisy, 0, 65535).astype(np.uint16))


def misplaced(image: SpcImage, number: int) -> SpcImage:
    """The image with a state that is off by some pixels, by a roll, and by 0.3 % of the range."""
    rng = np.random.default_rng([number, 2])
    turns = rng.normal(size=3) * [4.0 / 6000.0, 4.0 / 6000.0, 0.01]
    off = 0.003 * np.linalg.norm(image.scobj) * rng.normal(size=3)
    return replace(image, axes=rotate_axes(image.axes, turns), scobj=image.scobj + off)


def fitted(caster: RayCaster, image: SpcImage):
    match = compare_frame(
        image.pixels, render_frame(caster, image, step=2), lowest=100.0, reach_px=32.0
    )
    options = FrameFitOptions(MINNAERT, 0.003 * float(np.linalg.norm(image.scobj)))
    return fit_frame(image, caster, match=match, options=options)


def error(found: SpcImage, true: SpcImage) -> np.ndarray:
    """Error of pixel and line of the ground in the middle, of the roll and of the range."""
    middle = 0.7 * RADIUS * true.position / np.linalg.norm(true.position)
    place = np.array(project_image(found, middle)) - project_image(true, middle)
    turn = Rotation.from_matrix(found.axes @ true.axes.T).as_rotvec()[2]
    away = np.linalg.norm(found.scobj) - np.linalg.norm(true.scobj)
    return np.array([*place, turn, away / np.linalg.norm(true.scobj)])


def test_planted_errors_come_back_with_the_true_shape() -> None:
    true, _ = casters()
    for number in range(2):
        image = photographed(true, number)
        given = misplaced(image, number)
        found = fitted(true, given)
        assert found.settled
        assert found.correlation > 0.99
        assert np.abs(error(given, image)[:2]).max() > 0.5
        off = error(found.image, image)
        assert np.abs(off[:2]).max() < 0.05
        assert abs(off[2]) < 5e-4
        assert abs(off[3]) < 5e-4


def test_sigmas_with_a_shape_that_lacks_fine_relief() -> None:
    true, known = casters()
    pulls = []
    for number in range(4):
        image = photographed(true, number)
        found = fitted(known, misplaced(image, number))
        off = error(found.image, image)[:3]
        pulls.append(off / [*found.sigma_px, found.image.pointing_sigma[2]])
        # What the .SUM states is the place of the ground.
        stated = found.image.pointing_sigma[:2] / LENS.pixel_angle
        np.testing.assert_allclose(stated, np.sqrt(np.mean(np.square(found.sigma_px))))
    rms = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert (rms > 0.3).all()
    assert (rms < 1.4).all()


def test_what_cannot_be_fitted_is_refused() -> None:
    true, _ = casters()
    image = photographed(true, 1)
    match = compare_frame(
        image.pixels, render_frame(true, image, step=2), lowest=100.0, reach_px=32.0
    )
    with pytest.raises(InvalidValueError, match="no pixels"):
        fit_frame(replace(image, pixels=None), true, match=match)
    with pytest.raises(InvalidValueError, match="no lit ground"):
        fit_frame(replace(image, sun=-image.position / np.linalg.norm(image.position)), true,
                  match=match)  # fmt: skip
    with pytest.raises(SettingsError, match="position-sigma"):
        FrameFitOptions(position_sigma=0.0)
