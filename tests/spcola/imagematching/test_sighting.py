from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from spcola.camera import project_image
from spcola.control.estimation import (
    MeasuredLandmarks,
    measured_sigma,
    state_covariance,
    state_partials,
)
from spcola.grids import Maplet
from spcola.imagematching import (
    ChoiceOptions,
    Sighting,
    SightOptions,
    SizeFactors,
    agreeing,
    choose_images,
    estimate_factors,
    find_ground,
)
from spcola.photometry.functions import lambert
from spcola.photometry.image_blur import ImageBlur, ImageBlurs

VIEWS = [[0.6, 0.1, 1.0], [-0.5, 0.4, 1.0], [0.1, -0.6, 1.0], [-0.2, -0.2, 1.0]]
LIGHTS = [[0.5, 0.2, 0.8], [-0.4, 0.4, 0.9], [0.3, -0.5, 0.8], [-0.6, -0.1, 0.9]]
NO_FIXES = MeasuredLandmarks(np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 3)))


@pytest.fixture(scope="module")
def photographs(waves):
    return [
        waves.photograph(f"P{k}", view, light, pixel=0.4, size=140, samples=2)
        for k, (view, light) in enumerate(zip(VIEWS, LIGHTS, strict=True))
    ]


@pytest.fixture(scope="module")
def states(waves, photographs):
    return {
        image.name: state_covariance(image, waves.grid.center, NO_FIXES, sigma_px=0.3)
        for image in photographs
    }


def sought(waves, photographs, states, off, **more):
    """Look for the ground displaced by `off` (local, metres)."""
    grid = replace(waves.grid, center=waves.grid.center - np.array(off) @ waves.grid.axes)
    options = SightOptions(function=lambert, **more)
    ground = Maplet("GROUND", grid, waves.heights())
    return find_ground(ground, photographs, states, exposed=lambda image: image, options=options)


def test_displaced_ground_is_found_in_three_dimensions(waves, photographs, states):
    found = sought(waves, photographs, states, [0.7, -0.5, 0.6])
    assert len(found) == 4
    error = waves.grid.axes @ (found.solve().estimate - waves.grid.center)
    assert np.abs(error).max() < 0.01, error
    assert np.min(found.correlation) > 0.95


def test_a_smeared_image_is_rendered_with_its_smear(waves, photographs, states):
    """A mean of seven sub-frames, each a pixel further."""
    smeared = ndimage.uniform_filter1d(photographs[0].pixels.astype(float), 7, axis=1)
    images = [replace(photographs[0], pixels=np.rint(smeared).astype(np.uint16)), *photographs[1:]]
    blurs = ImageBlurs((("P0", ImageBlur(0.0, (7.0, 0.0))),))
    without, right = (
        sought(waves, images, states, [0.2, 0.1, 0.0], blurs=one) for one in (ImageBlurs(), blurs)
    )
    assert 1.0 - right.correlation[0] < 0.5 * (1.0 - without.correlation[0])
    assert right.correlation[1:] == pytest.approx(without.correlation[1:], abs=1e-3)


def test_an_image_with_a_wrong_state_is_left_out(waves, photographs, states):
    wrong = replace(photographs[3], scobj=photographs[3].scobj + 0.6 * waves.grid.ux)
    tight = {name: 1e-6 * covariance for name, covariance in states.items()}
    more = waves.photograph("P4", [0.4, 0.5, 1.0], LIGHTS[0], pixel=0.4, size=140, samples=2)
    tight["P4"] = tight["P0"]
    found = sought(waves, [*photographs[:3], wrong, more], tight, [0.2, 0.0, 0.0])
    assert found.left_out == {"P3": "contradicts the other images"}
    error = waves.grid.axes @ (found.solve().estimate - waves.grid.center)
    assert np.abs(error).max() < 0.01, error


def test_one_image_gives_no_place_and_says_so(waves, photographs, states):
    found = sought(waves, photographs[:1], states, [0.0, 0.0, 0.0])
    assert len(found) == 0
    assert "no other image" in found.left_out["P0"]


def many(photographs, states, rng, *, match):
    """Sightings of 40 places with errors of matches, pixels."""
    sightings = []
    for number in range(40):
        place = 80.0 * np.array([0.9, 0.3, 0.2]) + rng.normal(size=3)
        seen = []
        for image in photographs:
            noise = match * rng.normal(size=2)
            seen.append(np.array(project_image(image, place)) + noise)
        count = len(photographs)
        sightings.append(
            Sighting(
                f"S{number}",
                place,
                tuple(photographs),
                np.array(seen),
                np.tile(1e-4 * np.eye(2), (count, 1, 1)),
                np.array([states[image.name] for image in photographs]),
                np.ones(count),
                np.ones(count),
            )
        )
    return sightings


def test_sizes_of_errors_follow_from_contradictions_of_images(photographs, states):
    rng = np.random.default_rng(2)
    tight = {name: 1e-8 * covariance for name, covariance in states.items()}
    found = estimate_factors(many(photographs, tight, rng, match=0.03))
    assert found.match == pytest.approx(3.0, rel=0.15)
    assert estimate_factors([]) == SizeFactors(1.0, 1.0, 1.0)


def test_factors_scale_covariances_and_are_taken_back(photographs, states):
    rng = np.random.default_rng(5)
    sighting = many(photographs, states, rng, match=0.01)[0]
    scaled = sighting.scaled(2.0, 0.5, 3.0)
    np.testing.assert_allclose(scaled.covariance, 4.0 * sighting.covariance)
    back = scaled.scaled(0.5, 2.0, 1.0 / 3.0)
    unit = np.sqrt(np.einsum("nii->ni", sighting.states))
    rest = (back.states - sighting.states) / (unit[:, :, None] * unit[:, None, :])
    assert np.abs(rest).max() < 1e-6
    assert len(agreeing(sighting)) == len(photographs)


def test_position_and_pointing_that_go_together_hardly_move_the_ground(waves, photographs, states):
    image, center = photographs[0], waves.grid.center
    rows = state_partials(image, center)
    together = np.sqrt(np.diag(rows @ states["P0"] @ rows.T))
    sigmas = np.concatenate([image.pointing_sigma, image.scobj_sigma])
    alone = np.sqrt(np.diag(rows @ np.diag(sigmas**2) @ rows.T))
    expected = 1e-5 / image.camera.pixel_angle
    np.testing.assert_allclose(together, expected, rtol=0.05)
    assert (alone > 5.0 * together).all()


def test_landmarks_constrain_a_state_better(waves, photographs):
    image, rng = photographs[0], np.random.default_rng(1)
    points = waves.grid.center + rng.uniform(-8, 8, (30, 2)) @ waves.grid.axes[:2]
    noise = 0.2 * rng.normal(size=(30, 2))
    observed = np.stack(project_image(image, points), axis=1) + noise
    fixes = MeasuredLandmarks(points, observed, np.full((30, 3), 0.01))
    assert measured_sigma([(image, fixes)]) == pytest.approx(0.2, abs=0.04)
    coarse = replace(image, pointing_sigma=np.full(3, 1e-3))
    loose = state_covariance(coarse, waves.grid.center, NO_FIXES, sigma_px=0.2)
    tight = state_covariance(coarse, waves.grid.center, fixes, sigma_px=0.2)
    assert np.diag(tight)[0] < 0.2 * np.diag(loose)[0]


def test_images_are_chosen_by_what_they_add(waves, photographs):
    grid = waves.grid
    coarse = waves.photograph("FAR", VIEWS[0], LIGHTS[0], pixel=5.0, size=40, samples=1)
    night = waves.photograph("NIGHT", VIEWS[1], [0.1, 0.0, -1.0], pixel=0.4, size=40, samples=1)
    flat = waves.photograph("LIMB", [3.0, 0.0, 1.0], LIGHTS[0], pixel=0.4, size=40, samples=1)
    everything = [*photographs, coarse, night, flat]
    names = [image.name for image in choose_images(grid, everything)]
    assert sorted(names) == ["P0", "P1", "P2", "P3"]
    two = choose_images(grid, everything, options=ChoiceOptions(most=2))
    views = [image.position - grid.center for image in two]
    cosine = views[0] @ views[1] / np.linalg.norm(views[0]) / np.linalg.norm(views[1])
    assert cosine < np.cos(np.radians(35.0))


def test_images_are_chosen_for_light_that_differs(waves):
    """Of two coarser images, the one in another light comes first for photoclinometry."""
    grid, light = waves.grid, [0.6, 0.0, 0.8]
    images = [
        waves.photograph(name, toward, sun, pixel=pixel, size=40, samples=1)
        for name, toward, sun, pixel in (
            ("A", [0.5, 0.0, 1.0], light, 0.6),
            ("B", [-0.5, 0.0, 1.0], light, 0.6),
            ("C", [0.0, 0.5, 1.0], light, 0.6),
            ("OTHER", [-0.1, -0.3, 1.0], [0.0, 0.6, 0.8], 1.2),
        )
    ]

    def names(options):
        return [image.name for image in choose_images(grid, images, options=options)]

    # Two directions of view come first: without them the place is not determined.
    assert "OTHER" in names(ChoiceOptions(most=3, light=lambert))
    assert names(ChoiceOptions(most=4))[-1] == "OTHER"
