"""Craters, boulders and spots: their power laws recovered from the catalogues, and the seed."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from spcola.errors import SettingsError
from spcola.truth.body import BodySettings, TruthBody, stream
from spcola.truth.body.relief import (
    BOULDER_HEIGHT,
    BOULDER_SLOPE,
    BURIED,
    CRATER_REACH,
    OUTLINE,
    Features,
    PowerLaw,
    SmoothSite,
    boulder_height,
    crater_height,
    directions,
    draw_boulders,
    spot_albedo,
)


@pytest.fixture(scope="module")
def body() -> TruthBody:
    return TruthBody()


def _slope(diameter: np.ndarray, law: PowerLaw) -> float:
    """Slope of the cumulative number by maximum likelihood, between the law's two ends."""
    trial = np.linspace(1.5, 4.5, 3001)
    width = law.smallest**-trial - law.largest**-trial
    likelihood = np.log(trial) - np.log(width) - (trial + 1.0) * np.mean(np.log(diameter))
    return float(trial[np.argmax(likelihood)])


@pytest.mark.parametrize("kind", ["craters", "boulders"])
def test_the_slope_is_recovered(body: TruthBody, kind: str) -> None:
    features: Features = getattr(body, kind)
    law: PowerLaw = getattr(body.settings, kind)
    assert law.slope == {"craters": 2.9, "boulders": 2.7}[kind]
    sigma = law.slope / np.sqrt(len(features))
    assert _slope(features.diameter, law) == pytest.approx(law.slope, abs=2.5 * sigma + 0.001)
    assert np.all(np.diff(features.diameter) <= 0.0)
    assert law.smallest <= features.diameter[-1] <= features.diameter[0] <= law.largest


@pytest.mark.parametrize("kind", ["craters", "boulders", "spots"])
def test_there_are_as_many_as_the_density_says(body: TruthBody, kind: str) -> None:
    features: Features = getattr(body, kind)
    law: PowerLaw = getattr(body.settings, kind)
    area = 4.0 * np.pi * 245.0**2
    # The site (0.3 % of the area, at low density) takes away fewer than a sigma of the boulders.
    assert abs(len(features) - law.expected(area)) < 3.0 * np.sqrt(law.expected(area))


def test_the_density_is_that_of_the_paper() -> None:
    for law, slope in ((BodySettings().craters, 2.9), (BodySettings().boulders, 2.7)):
        assert law.density_per_km2 == 1e4
        expected = 1e4 * (law.smallest**-slope - law.largest**-slope)
        assert law.expected(1e6) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("kind", ["craters", "boulders"])
def test_density_goes_as_the_cosine_of_the_longitude(body: TruthBody, kind: str) -> None:
    x = getattr(body, kind).direction[:, 0]
    contrast = getattr(body.settings, kind).contrast
    # Density (1 − c x)/(4π): the mean of x is −c/3, its variance 1/3 − c²/9.
    sigma = np.sqrt((1.0 / 3.0 - contrast**2 / 9.0) / len(x))
    assert np.mean(x) == pytest.approx(-contrast / 3.0, abs=3.0 * sigma)
    direction = getattr(body, kind).direction
    longitude = np.degrees(np.arctan2(direction[:, 1], direction[:, 0])) % 360.0
    # Over all latitudes the density goes as 1 − c (π/4) cos λ; its mean over λ0 ± 30°:
    swing = contrast * np.pi / 4.0 * np.sinc(1.0 / 6.0)
    for middle in (0.0, 90.0, 180.0, 270.0):
        inside = np.abs((longitude - middle + 180.0) % 360.0 - 180.0) < 30.0
        expected = len(x) / 6.0 * (1.0 - swing * np.cos(np.radians(middle)))
        assert abs(np.count_nonzero(inside) - expected) < 3.5 * np.sqrt(expected)


def test_an_even_law_is_even() -> None:
    d = directions(100_000, 0.0, stream(1, "test"))
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1.0, rtol=0, atol=1e-15)
    assert np.abs(d.mean(axis=0)).max() < 4.0 / np.sqrt(3e5)
    np.testing.assert_allclose(d.T @ d / len(d), np.eye(3) / 3.0, rtol=0, atol=0.005)


def test_roughness_is_greatest_at_90_and_270_degrees() -> None:
    none = PowerLaw(0.0, 2.7, 1.0, 2.0)
    rough = TruthBody(BodySettings(shape=0.0, craters=none, boulders=none, site=None))
    longitude = np.linspace(0.0, 2.0 * np.pi, 72_000, endpoint=False)
    ring = np.column_stack([np.cos(longitude), np.sin(longitude), 0.0 * longitude])
    steps = np.diff(rough.radius(ring)).reshape(-1) ** 2
    sector = np.rint(np.degrees(longitude[1:]) / 90.0).astype(int) % 4
    power = np.bincount(sector, steps) / np.bincount(sector)
    assert min(power[1], power[3]) > 2.0 * max(power[0], power[2])


def test_the_site_is_smooth_and_nearly_empty(body: TruthBody) -> None:
    site = body.settings.site
    assert site is not None
    assert site.radius_on(245.0) == 25.0
    assert site.radius_on(49.0) == pytest.approx(5.0)
    latitude = np.degrees(np.arcsin(site.direction[2]))
    longitude = np.degrees(np.arctan2(site.direction[1], site.direction[0])) % 360.0
    assert (latitude, longitude) == (pytest.approx(-10.0), pytest.approx(350.0))
    for features, law in (
        (body.craters, body.settings.craters),
        (body.boulders, body.settings.boulders),
    ):
        away = 245.0 * np.linalg.norm(features.direction - site.direction, axis=1)
        on_it = away < 25.0 + features.diameter / 2.0
        elsewhere = law.expected(np.pi * 25.0**2) * (1.0 - law.contrast * site.direction[0])
        assert np.count_nonzero(on_it) < 0.35 * elsewhere + 2.0
        assert features.diameter[on_it].max(initial=0.0) <= 2.5
    across = np.linspace(-1.0, 1.0, 4001)[:, None] * np.cross(site.direction, [0.0, 0.0, 1.0])
    on_site = np.diff(body.radius(site.direction + 0.09 * across)).std()
    off_side = np.diff(body.radius(site.direction + [0.0, 0.0, 0.3] + 0.09 * across)).std()
    assert on_site < 0.4 * off_side


def test_the_site_can_be_left_out() -> None:
    d = SmoothSite().direction + 0.01 * np.random.default_rng(0).normal(size=(50, 3))
    one, two = (TruthBody(BodySettings(radius=40.0, site=s)) for s in (SmoothSite(), None))
    assert np.abs(one.radius(d) - two.radius(d)).max() > 0.02
    assert len(two.boulders) >= len(one.boulders)


def test_a_boulder_is_an_ellipsoid_with_its_diameter_as_outline() -> None:
    law = PowerLaw(1e4, 2.7, 0.4, 10.0)
    boulders = draw_boulders(law, 245.0, 3)
    for row, diameter in zip(boulders.numbers[:50], boulders.diameter, strict=False):
        along = row[3:6] * (diameter / 2.0 / OUTLINE)
        assert np.linalg.norm(along) == pytest.approx(1.0, abs=1e-12)
        for share, stands in ((0.999, True), (1.001, False)):
            place = row[:3] + share * diameter / 2.0 / 245.0 * along
            assert (boulder_height(*place, 245.0, row) > 0.0) == stands
        top = boulder_height(*row[:3], 245.0, row)
        assert top == pytest.approx((1.0 - BURIED) * row[9])
        assert 0.1 * diameter < top < BOULDER_HEIGHT * diameter
        across = row[6:9] / (row[6:9] @ row[6:9])
        edge = [row[:3] + s * OUTLINE / 245.0 * across for s in (0.999, 1.0)]
        drop = boulder_height(*edge[0], 245.0, row) - boulder_height(*edge[1], 245.0, row)
        assert drop / (0.001 * OUTLINE * np.linalg.norm(across)) < BOULDER_SLOPE


def test_a_crater_is_a_bowl_with_a_round_rim() -> None:
    crater = np.array([0.0, 0.0, 1.0, 5.0, 1.4, 0.3])
    chord = np.linspace(0.0, 2.2, 2201) * 5.0 / 245.0
    profile = np.array([crater_height(c, 0.0, np.sqrt(1.0 - c * c), 245.0, crater) for c in chord])
    assert profile[0] == pytest.approx(-1.4)
    assert profile.max() == pytest.approx(0.3, abs=1e-4)
    assert abs(np.argmax(profile) / 1000.0 - 1.0) < 0.01
    assert np.all(profile[chord > CRATER_REACH * 5.0 / 245.0 * 1.001] == 0.0)
    slope = np.diff(profile) / 0.005
    assert np.abs(slope).max() < 0.6
    assert np.abs(np.diff(slope)).max() < 0.01


def test_spots_are_bright_and_dark_and_isolated(body: TruthBody) -> None:
    spots = body.spots
    albedo = body.albedo(spots.direction)
    bright = spots.numbers[:, 4] > 0.0
    assert 0.3 < bright.mean() < 0.7
    assert np.median(albedo[bright]) > 1.25
    assert np.median(albedo[~bright]) < 0.85
    assert np.sum(np.pi / 4.0 * spots.diameter**2) < 0.005 * 4.0 * np.pi * 245.0**2
    assert spot_albedo(0.0, 0.1, 1.0, 245.0, np.array([0.0, 0.0, 1.0, 5.0, 0.4])) == 0.0


def test_the_same_seed_gives_the_same_body_and_another_another() -> None:
    d = directions(50, 0.0, stream(1, "test"))
    one, two = (TruthBody(BodySettings(seed=3, radius=40.0)).radius(d) for _ in range(2))
    np.testing.assert_array_equal(one, two)
    assert np.abs(TruthBody(BodySettings(seed=4, radius=40.0)).radius(d) - one).max() > 0.1


def test_a_seed_is_one_body_on_every_machine(body: TruthBody) -> None:
    d = np.vstack([directions(2000, 0.0, stream(1, "test")), body.boulders.direction[:50]])
    digest = hashlib.sha256(body.radius(d).astype("<f8").tobytes())
    digest.update(body.albedo(d).astype("<f8").tobytes())
    assert digest.hexdigest()[:16] == "ddfa89227c8eb7f4"


@pytest.mark.parametrize(
    "wrong", [(-1.0, 2.0, 1.0, 2.0), (1.0, 0.0, 1.0, 2.0), (1.0, 2.0, 3.0, 2.0)]
)
def test_power_laws_out_of_range_are_refused(wrong: tuple[float, ...]) -> None:
    with pytest.raises(SettingsError):
        PowerLaw(*wrong)


@pytest.mark.parametrize("wrong", [{"diameter": 0.0}, {"share": 1.1}, {"latitude_deg": 91.0}])
def test_sites_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(SettingsError):
        SmoothSite(**wrong)
