from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.camera import Camera, rotate_axes
from spcola.camera.distortion import COEFFICIENTS
from spcola.camera.stars import (
    StarCatalogue,
    StarFrame,
    calibrate,
    solved_parameters,
    with_model,
)
from spcola.camera.stars.catalogue import apparent_directions
from spcola.camera.stars.identification import identify
from spcola.camera.stars.parameters import SolvedParameters
from spcola.errors import InvalidValueError, NotObservableError


def nominal(lens: Camera) -> Camera:
    """What is known before: the focal length to 0.03 %, no distortion, axes at right angles."""
    return replace(
        lens, focal_length_mm=lens.focal_length_mm * 1.0003, distortion=np.zeros(4),
        k_matrix=[[117.647, 0, 0], [0, -117.647, 0]],
    )  # fmt: skip


def frames_of(sky, lens, count=6, **options):
    """Identified frames, their planted attitudes, and how many stars were right, false, missed."""
    frames, truth, tally = [], [], np.zeros(3, dtype=int)
    for number in range(count):
        axes = sky.attitude()
        stars, places = sky.frame(lens, axes, **options)
        about = rotate_axes(axes, sky.random.normal(scale=[1e-3, 1e-3, 1e-3]))
        found = identify(nominal(lens), about, stars, sky.catalogue)
        right = places[found.measured] == found.catalogue
        tally += [right.sum(), (~right).sum(), (places >= 0).sum() - right.sum()]
        chosen = type(stars)(
            stars.pixel[found.measured], stars.line[found.measured],
            stars.covariance[found.measured], stars.flux[found.measured],
        )  # fmt: skip
        directions = sky.catalogue.directions[found.catalogue]
        frames.append(StarFrame(f"S{number}", chosen, directions, found.axes))
        truth.append(axes)
    return frames, truth, tally


def test_planted_values_come_back_within_their_sigmas(sky, lens) -> None:
    pulls, attitude_pulls, units, tally = [], [], [], np.zeros(3, dtype=int)
    for seed in range(12):
        frames, truth, counts = frames_of(sky(seed), lens)
        tally += counts
        start = nominal(lens)
        solved = calibrate(frames, start, solved_parameters(start))
        assert solved.converged
        units.append(solved.unit_variance)
        planted = SolvedParameters(solved.names).value(lens)
        pulls.append((solved.estimate - planted) / solved.sigma)
        for frame, axes in zip(solved.frames, truth, strict=True):
            turn = axes @ frame.axes.T
            away = np.array([turn[1, 2], turn[2, 0], turn[0, 1]])
            attitude_pulls.append(away / np.sqrt(np.diag(frame.covariance)))
    assert solved.names[:3] == ("focal_length_mm", "k_xy", "k_yy")
    assert np.all(np.abs(np.std(pulls, axis=0) - 1.0) < 0.6)
    assert np.std(pulls) == pytest.approx(1.0, abs=0.12)
    assert np.std(attitude_pulls) == pytest.approx(1.0, abs=0.1)
    assert np.mean(units) == pytest.approx(1.0, abs=0.03)
    right, wrong, missed = tally
    assert wrong < 0.01 * right
    assert missed < 0.01 * right


def test_false_stars_do_not_steer_it(sky, lens) -> None:
    frames, _, _ = frames_of(sky(1), lens, 4)
    random = np.random.default_rng(5)
    spoilt = []
    for frame in frames:
        directions = frame.directions.copy()
        wrong = random.permutation(len(directions))[: len(directions) // 5]
        directions[wrong] += random.normal(scale=2e-3, size=(len(wrong), 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        spoilt.append(replace(frame, directions=directions))
    solved = calibrate(spoilt, nominal(lens), solved_parameters(lens))
    planted = SolvedParameters(solved.names).value(lens)
    assert np.all(np.abs(solved.estimate - planted) < 4.5 * solved.sigma)
    rejected = sum(np.count_nonzero(~frame.used) for frame in solved.frames)
    assert rejected == pytest.approx(0.2 * sum(len(f.directions) for f in frames), rel=0.1)


@pytest.mark.parametrize(
    ("model", "planted"),
    [
        ("brown", [-0.5, 30.0, 1e-3, -2e-3]),
        ("bicubic", [0, 0, 0, 2e-5, 1e-5, -1e-5, 2e-5, 1e-5, 1e-5, 3e-5,
                     0, 0, 0, -1e-5, 1e-5, 2e-5, 1e-5, 1e-5, -2e-5, 1e-5]),
        ("radial", [0.0, 3e-5, -1e-7]),
        ("ocams", [-0.2, 0.1, 0.0, 1e-4, 3e-5, 1e-6, 1e-8]),
        ("hasselblad", [0.0, 0.0, 3e-5, -1e-7, 1e-9, 1e-5, 1e-7, 0.5]),
    ],
)  # fmt: skip
def test_every_model_is_met(sky, lens, model, planted) -> None:
    other = replace(lens, distortion_model=model, distortion=planted)
    frames, _, _ = frames_of(sky(3), other, 8, false=0)
    zeros = np.array(planted)
    free = [int(n[11:-1]) for n in solved_parameters(other).names if n.startswith("dist")]
    zeros[free] = 0.0
    start = replace(nominal(lens), distortion_model=model, distortion=zeros + 1e-300)
    solved = calibrate(frames, start, solved_parameters(start))
    assert solved.converged
    assert solved.unit_variance == pytest.approx(1.0, abs=0.1)
    pulls = (solved.estimate - SolvedParameters(solved.names).value(other)) / solved.sigma
    assert np.max(np.abs(pulls)) < 3.5


def test_a_model_that_does_not_fit_shows_in_the_unit_variance(sky, lens) -> None:
    strong = replace(lens, distortion=np.array([3e-4, -3e-7, 0, 0]))
    frames, _, _ = frames_of(sky(3), strong, 4, false=0)
    solved = calibrate(frames, nominal(lens), solved_parameters(lens, distortion=False))
    assert solved.unit_variance > 1.5


def test_the_center_needs_attitudes_that_are_known(sky, lens) -> None:
    source = sky(4)
    frames, truth, _ = frames_of(source, lens, 6, false=0)
    parameters = solved_parameters(lens, center=True, distortion=False)
    start = replace(nominal(lens), distortion=lens.distortion)
    known = [
        replace(frame, axes=rotate_axes(axes, source.random.normal(scale=1e-6, size=3)),
                attitude_sigma=1e-6)
        for frame, axes in zip(frames, truth, strict=True)
    ]  # fmt: skip
    loose = calibrate(frames, start, parameters)
    tight = calibrate(known, start, parameters)
    at = tight.names.index("center_pixel")
    assert tight.sigma[at] < 0.05 < loose.sigma[at] / 10
    pulls = (tight.estimate - SolvedParameters(tight.names).value(lens)) / tight.sigma
    assert np.max(np.abs(pulls)) < 3.5


def test_what_stars_do_not_determine_is_named(sky, lens) -> None:
    frames, _, _ = frames_of(sky(4), lens, 3, false=0)
    # a scale of x and of y is a focal length
    start = replace(nominal(lens), distortion_model="bicubic", distortion=np.zeros(20) + 1e-300)
    with pytest.raises(NotObservableError, match=r"do not determine .*distortion\[1\]") as caught:
        calibrate(
            frames, start, SolvedParameters(("focal_length_mm", "distortion[1]", "distortion[12]"))
        )
    assert "focal_length_mm" in caught.value.parameters


def test_aberration_is_a_scale(sky, lens) -> None:
    ahead = apparent_directions(
        [[0.0, 0.0, 1.0], [np.sin(0.01), 0.0, np.cos(0.01)]], [0.0, 0.0, 3e4]
    )
    assert np.arctan2(ahead[1, 0], ahead[1, 2]) == pytest.approx(
        0.01 * (1 - 3e4 / 299792458), rel=1e-6
    )
    np.testing.assert_allclose(ahead[0], [0, 0, 1])
    side = apparent_directions([[0.0, 0.0, 1.0]], [3e4, 0.0, 0.0])
    assert side[0, 0] == pytest.approx(3e4 / 299792458, rel=1e-9)
    with pytest.raises(InvalidValueError, match="no spacecraft's"):
        apparent_directions([[0, 0, 1.0]], [3e7, 0, 0])


def test_identification_refuses_what_chance_gives(sky, lens) -> None:
    source = sky(8)
    axes = source.attitude()
    stars, _ = source.frame(lens, axes)
    elsewhere = Rotation.from_rotvec([0.02, 0.02, 1.0]).as_matrix() @ axes
    with pytest.raises(NotObservableError, match="chance"):
        identify(nominal(lens), elsewhere, stars, source.catalogue)


def test_a_catalogue_far_deeper_than_the_image(sky, lens) -> None:
    # Forty faint stars for each that the image has: every false star would have one within 3 px.
    source = sky(8)
    axes = source.attitude()
    stars, places = source.frame(lens, axes, false=10)
    faint = source.random.uniform(-0.08, 0.08, (16_000, 2))
    faint = np.column_stack([faint, np.ones(len(faint))])
    faint /= np.linalg.norm(faint, axis=1, keepdims=True)
    catalogue = source.catalogue
    deep = StarCatalogue(
        np.concatenate([catalogue.directions, faint]),
        np.concatenate([catalogue.magnitudes, np.full(len(faint), 12.0)]),
    )
    about = rotate_axes(axes, [1e-3, -1e-3, 0.0])
    found = identify(nominal(lens), about, stars, deep)
    right = np.count_nonzero(places[found.measured] == found.catalogue)
    assert right > 0.98 * np.count_nonzero(places >= 0)
    assert len(found.measured) - right < 0.02 * right


def test_models_start_from_none(lens) -> None:
    for model in COEFFICIENTS:
        if model in ("rosetta", "hayabusa2"):
            with pytest.raises(InvalidValueError, match="pixel size"):
                with_model(lens, model)
        else:
            assert with_model(lens, model).distortion_model == model
