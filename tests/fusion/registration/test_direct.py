"""Surfaces registered without mapolas between: two clouds, and returns to SPC surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from fusion.estimation.verdict import Code, Verdict
from fusion.registration.clouds.blur import relative_blur, significant_blur
from fusion.registration.clouds.clouds import CloudOptions, register_clouds
from fusion.registration.clouds.not_aligned import NotAlignedError
from fusion.registration.direct import DirectRegistration
from fusion.registration.returns import (
    CloudOfReturns,
    FixedSurface,
    SurfaceNormalEquations,
    match_returns,
)
from fusion.registration.transform.parameters import LIDAR_FRAME, SPC_FRAME
from fusion.stages.register.scan_fits import ScanFit
from fusion.surfacematch import Match, Surface
from spcola.errors import InvalidValueError, NotObservableError
from spcola.grids import MapletGrid
from spcola.math import Affine, Similarity

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Terrain:
    """Fractal ground over a square of `side` metres: slopes of one power in every octave."""

    seed: int
    side: float = 30.0
    slope: float = 0.2
    nodes: int = 512

    @property
    def step(self) -> float:
        return 1.2 * self.side / self.nodes

    def spectrum(self) -> tuple[NDArray[Any], Array, Array]:
        generator = np.random.default_rng(self.seed)
        wave = 2.0 * np.pi * np.fft.fftfreq(self.nodes, self.step)
        along, down = wave[None], wave[:, None]
        length = np.hypot(along, down)
        length[0, 0] = np.inf
        white = np.fft.fft2(generator.normal(size=(self.nodes, self.nodes)))
        shaped = white * length**-2.0
        slopes = [np.fft.ifft2(1j * each * shaped).real for each in (along, down)]
        return shaped * self.slope / np.hypot(slopes[0].std(), slopes[1].std()), along, down

    def heights(self, x: Array, y: Array, blur_m: float = 0.0) -> Array:
        """Heights at points, of the ground smoothed by a Gaussian of `blur_m` metres."""
        shaped, along, down = self.spectrum()
        soft = shaped * np.exp(-0.5 * blur_m**2 * (along**2 + down**2))
        return self._at(np.fft.ifft2(soft).real, x, y)

    def slopes(self, x: Array, y: Array) -> tuple[Array, Array]:
        shaped, along, down = self.spectrum()
        layers = [np.fft.ifft2(1j * each * shaped).real for each in (along, down)]
        return self._at(layers[0], x, y), self._at(layers[1], x, y)

    def _at(self, layer: Array, x: Array, y: Array) -> Array:
        places = [y / self.step + self.nodes / 2, x / self.step + self.nodes / 2]
        return ndimage.map_coordinates(layer, places, order=3, mode="grid-wrap")

    def cloud(self, number: int, count: int, noise_m: float, blur_m: float = 0.0) -> Array:
        """Points at random places, the same for one `number`."""
        generator = np.random.default_rng(1000 * self.seed + number)
        x, y = generator.uniform(-self.side / 2, self.side / 2, (2, count))
        noise = noise_m * generator.normal(size=count)
        return np.stack([x, y, self.heights(x, y, blur_m) + noise], axis=1)

    def limit(self, cloud: Array, variance: float) -> Array:
        """Cramér–Rao sigmas (7,) of a similarity; `variance` is that of one point's difference."""
        slope_x, slope_y = self.slopes(cloud[:, 0], cloud[:, 1])
        up = np.stack([-slope_x, -slope_y, np.ones(len(cloud))], axis=1)
        rows = np.concatenate(
            [up, np.cross(cloud, up), np.sum(cloud * up, axis=1)[:, None]], axis=1
        )
        return np.sqrt(variance * np.diag(np.linalg.inv(rows.T @ rows)))


PLANTED = Similarity.from_rotation_vector(
    np.radians(0.02) * np.array([0.6, -0.6, 0.5]), [0.06, -0.05, 0.04], 1.0 - 5e-4, "spc", "lidar"
)


def moved_back(cloud: Array, transform: Similarity | Affine = PLANTED) -> Array:
    """Return the cloud that `transform` takes to `cloud`."""
    return transform.inverse().apply(cloud)


def errors(found: Similarity, planted: Similarity = PLANTED) -> Array:
    """Translation, rotation and scale (7,) of what was found less what was planted."""
    turn = Similarity(found.rotation @ planted.rotation.T).rotation_vector
    return np.array(
        [*(found.translation - planted.translation), *turn, found.scale - planted.scale]
    )


def sigmas(found: DirectRegistration | ScanFit) -> Array:
    return np.sqrt(np.diag(found.covariance))


NOISE_M = 0.01
POINTS = 60_000


def two_clouds(seed: int, blur_m: tuple[float, float] = (0.0, 0.0)) -> tuple[Array, Array, Array]:
    """A moving and a fixed cloud, and the formal limit of what they determine."""
    ground = Terrain(seed)
    one, two = (ground.cloud(k, POINTS, NOISE_M, blur_m[k]) for k in range(2))
    return moved_back(one), two, ground.limit(one, 2.0 * NOISE_M**2)


def test_clouds_are_registered_near_the_formal_limit_with_true_sigmas() -> None:
    ratios, pulls = [], []
    for seed in range(8):
        moving, fixed, limit = two_clouds(seed)
        found = register_clouds(moving, fixed)
        assert found.converged
        ratios.append(errors(found.similarity) / limit)
        pulls.append(errors(found.similarity) / sigmas(found))
    ratio, pull = (np.sqrt(np.mean(np.square(each))) for each in (ratios, pulls))
    assert ratio < 1.5
    assert 0.8 < pull < 1.2


@pytest.mark.parametrize("model", ["rigid", "similarity", "affine"])
def test_every_model_of_clouds_is_recovered(model: str) -> None:
    matrix = np.eye(3) + (np.diag([4e-3, 0.0, 0.0]) if model == "affine" else 0.0)
    scale = 1.0 if model == "rigid" else PLANTED.scale
    planted = Affine(scale * PLANTED.rotation @ matrix, PLANTED.translation, "fixed", "moving")
    fixed = Terrain(3).cloud(1, POINTS, NOISE_M)
    moving = moved_back(Terrain(3).cloud(0, POINTS, NOISE_M), planted)
    found = register_clouds(moving, fixed, options=CloudOptions(model=model))  # type: ignore[arg-type]
    assert len(found.covariance) == {"rigid": 6, "similarity": 7, "affine": 12}[model]
    off = (found.transform.matrix - planted.matrix).ravel()
    if model == "affine":
        assert np.all(np.abs(off) < 4.0 * sigmas(found)[3:])
    else:
        assert np.abs(off).max() < 4.0 * sigmas(found)[3:].max()
    assert np.all(np.abs(found.transform.translation - planted.translation) < 4 * sigmas(found)[:3])


def test_clouds_may_lie_anywhere_and_a_metre_apart() -> None:
    frame = Similarity.from_rotation_vector([0.7, -0.4, 1.1], [100.0, -200.0, 60.0])
    planted = Similarity.from_rotation_vector([0.0, 1e-3, 0.0], [0.6, 0.5, -0.4], 1.0)
    fixed, moving = Terrain(4).cloud(1, POINTS, NOISE_M), Terrain(4).cloud(0, POINTS, NOISE_M)
    there = (frame @ planted.inverse()).apply(moving)
    found = register_clouds(there, frame.apply(fixed))
    expected = frame.apply(moving)
    assert np.abs(found.transform.apply(there) - expected).max() < 0.005
    assert found.verdict == Verdict()


def test_clouds_of_other_ground_are_refused() -> None:
    fixed, moving = Terrain(4).cloud(1, POINTS, NOISE_M), Terrain(5).cloud(0, POINTS, NOISE_M)
    with pytest.raises(NotAlignedError, match="have relief, but none in common") as caught:
        register_clouds(moving, fixed)
    assert caught.value.code is Code.RELIEF_UNRELATED


@pytest.mark.parametrize("turned", [[[0, -1, 0], [1, 0, 0]], [[-1, 0, 0], [0, 1, 0]]])
def test_clouds_turned_or_mirrored_have_no_relief_in_common(turned: list[list[int]]) -> None:
    fixed, moving = Terrain(4).cloud(1, POINTS, NOISE_M), Terrain(4).cloud(0, POINTS, NOISE_M)
    matrix = np.array([*turned, [0, 0, 1]], dtype=float)
    with pytest.raises(NotObservableError, match="have relief, but none in common"):
        register_clouds(moving @ matrix.T, fixed)


def test_stray_points_do_not_pull() -> None:
    moving, fixed, _ = two_clouds(5)
    clean = register_clouds(moving, fixed)
    assert clean.verdict == Verdict()
    outliers = np.random.default_rng(0).integers(0, POINTS, 600)
    spoilt = moving.copy()
    spoilt[outliers, 2] += np.random.default_rng(1).uniform(1.0, 5.0, 600)
    found = register_clouds(spoilt, fixed)
    change = errors(found.similarity, clean.similarity) / sigmas(clean)
    assert np.sqrt(np.mean(np.square(change))) < 0.8


def test_a_plane_leaves_what_slides_along_it_free() -> None:
    generator = np.random.default_rng(0)
    clouds = generator.uniform(-15, 15, (2, 40_000, 3))
    clouds[..., 2] = 0.01 * generator.normal(size=(2, 40_000))
    with pytest.raises(NotObservableError, match="determine") as caught:
        register_clouds(clouds[0], clouds[1])
    assert {"tx_m", "ty_m", "rz_rad"} <= set(caught.value.parameters)


def test_too_few_points_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="100 are needed"):
        register_clouds(np.zeros((10, 3)), np.zeros((1000, 3)))


@pytest.mark.parametrize("softer", [0, 1])
def test_blur_of_one_cloud_is_told_through_its_noise(softer: int) -> None:
    step = 0.12
    grid = np.round(np.arange(-125, 126)) * step
    x, y = np.meshgrid(grid, grid)
    generator = np.random.default_rng(7)
    surfaces = []
    for which in range(2):
        soft = Terrain(6).heights(x, y, 1.5 * step if which == softer else 0.0)
        surfaces.append(tuple(soft + 0.005 * generator.normal(size=x.shape) for _ in range(2)))
    square, sigma = relative_blur(surfaces[0], surfaces[1])  # type: ignore[arg-type]
    expected = 1.5**2 * (1 if softer else -1)
    assert abs(square - expected) < max(4.0 * sigma, 0.3)
    assert significant_blur(square, sigma) == pytest.approx(np.sign(expected) * 1.5, abs=0.1)
    assert significant_blur(0.01, 0.02) == 0.0


def test_smoothing_one_cloud_biases_the_scale_unless_both_are_smoothed() -> None:
    changes: dict[float | None, list[float]] = {0.0: [], None: []}
    for seed in range(4):
        moving, fixed, _ = two_clouds(seed)
        plain = register_clouds(moving, fixed)
        _, soft, _ = two_clouds(seed, (0.0, 0.24))
        for blur, found in changes.items():
            result = register_clouds(moving, soft, options=CloudOptions(blur_cells=blur))
            change = result.similarity.scale - plain.similarity.scale
            found.append(change / sigmas(result)[6])
    assert np.mean(changes[0.0]) < -2.5
    assert abs(np.mean(changes[None])) < 1.0


GSD = 0.3
SURFACE = MapletGrid(np.zeros(3), np.eye(3), GSD, 45)


def spc_surface(seed: int, *, blur_cells: float = 0.0, error_m: float = 0.02) -> Array:
    """Heights as SPC gives them: smoothed, and with errors correlated over cells."""
    x, y = np.meshgrid(GSD * SURFACE.offsets, GSD * SURFACE.offsets)
    error = ndimage.gaussian_filter(np.random.default_rng(seed + 50).normal(size=x.shape), 2.0)
    soft = Terrain(seed).heights(x, y, blur_cells * GSD)
    return soft + error_m * error / error.std()


def returns_of(cloud: Array, transform: Similarity | Affine = PLANTED) -> CloudOfReturns:
    return CloudOfReturns(moved_back(cloud, transform), np.full(len(cloud), NOISE_M))


def fitted(
    parts: list[tuple[CloudOfReturns, FixedSurface]], maplet_sigma_m: float = 0.0
) -> ScanFit:
    """The transform of the returns on some surfaces, as that of a scan is found."""
    begin = Affine(np.eye(3), np.zeros(3), SPC_FRAME, LIDAR_FRAME)
    center = np.mean([fixed.grid.center for _, fixed in parts], axis=0)
    fit = ScanFit("similarity", begin, np.full((7, 7), np.inf), center)
    for _ in range(4):
        found = [fit.equations(cloud, fixed) for cloud, fixed in parts]
        known: list[SurfaceNormalEquations] = [each for each in found if each is not None]
        fit = fit.stepped(known, maplet_sigma_m)
    return fit


def registered(cloud: Array, height: Array, blur_cells: float = 0.0) -> ScanFit:
    return fitted([(returns_of(cloud), FixedSurface(SURFACE, Surface(height), blur_cells))])


def test_returns_are_registered_to_a_surface_with_true_sigmas() -> None:
    pulls = []
    for seed in range(10):
        found = registered(Terrain(seed).cloud(0, 40_000, NOISE_M), spc_surface(seed))
        pulls.append(errors(found.similarity) / sigmas(found))
    assert 0.75 < np.sqrt(np.mean(np.square(pulls))) < 1.25


def boulders(seed: int, x: Array, y: Array) -> Array:
    """Half spheres of 0.4 to 0.8 m on the ground."""
    generator = np.random.default_rng(seed + 90)
    places, radii = generator.uniform(-13, 13, (25, 2)), generator.uniform(0.4, 0.8, 25)
    height = np.zeros(np.shape(x))
    for (left, up), radius in zip(places, radii, strict=True):
        room = radius**2 - (x - left) ** 2 - (y - up) ** 2
        height = np.maximum(height, np.sqrt(np.maximum(room, 0.0)))
    return height


@pytest.mark.parametrize("cells", [1.0, 2.0])
def test_soft_surface_and_short_boulders_do_not_bias_the_scale(cells: float) -> None:
    """SPC smooths, and shows 60 % of the boulders' height."""
    x, y = np.meshgrid(GSD * SURFACE.offsets, GSD * SURFACE.offsets)
    changes = []
    for seed in range(6):
        cloud = Terrain(seed).cloud(0, 40_000, NOISE_M)
        plain = registered(cloud, spc_surface(seed))
        cloud[:, 2] += boulders(seed, cloud[:, 0], cloud[:, 1])
        short = 0.6 * ndimage.gaussian_filter(boulders(seed, x, y), cells)
        soft = registered(cloud, spc_surface(seed, blur_cells=cells) + short, cells)
        changes.append((soft.similarity.scale - plain.similarity.scale) / sigmas(soft)[6])
    assert abs(np.mean(changes)) < 1.0
    assert np.max(np.abs(changes)) < 2.0


def test_many_surfaces_around_a_body_are_fitted_together() -> None:
    """Maplets all around, each with an error of its centre."""
    planted = Similarity.from_rotation_vector([2e-4, -1e-4, 3e-4], [0.1, -0.05, 0.07], 1.0 + 4e-4)
    generator, pulls = np.random.default_rng(0), []
    normals = generator.normal(size=(30, 3))
    for _ in range(3):
        parts = []
        for k, normal in enumerate(normals / np.linalg.norm(normals, axis=1)[:, None]):
            grid = MapletGrid.facing(40.0 * normal, normal, 0.5, 12)
            ground = Terrain(k, nodes=128)
            height = ground.heights(*np.meshgrid(0.5 * grid.offsets, 0.5 * grid.offsets))
            x, y = generator.uniform(-7, 7, (2, 2500))
            local = np.stack([x, y, ground.heights(x, y)], axis=1)
            shifted = local + 0.03 * generator.normal(size=3)
            cloud = returns_of(grid.center + shifted @ grid.axes, planted)
            parts.append((cloud, FixedSurface(grid, Surface(height))))
        found = fitted(parts, maplet_sigma_m=0.03)
        assert found.surfaces == 30
        pulls.append(errors(found.similarity, planted) / sigmas(found))
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.5


def test_returns_beside_all_surfaces_fit_nothing() -> None:
    far = Terrain(0).cloud(0, 5000, NOISE_M) + np.array([500.0, 0.0, 0.0])
    assert registered(far, spc_surface(0)).reason.startswith("no maplet is covered")


def matched(seed: int, moved: tuple[float, float, float]) -> Match:
    shift = Affine(np.eye(3), np.array(moved), "spc", "lidar")
    returns = returns_of(Terrain(seed).cloud(0, 40_000, NOISE_M), shift)
    return match_returns("M", returns, FixedSurface(SURFACE, Surface(spc_surface(seed))))


def test_a_single_surface_gives_a_displacement_with_a_true_sigma() -> None:
    pulls = []
    for seed in range(8):
        match = matched(seed, (0.8, -0.5, 0.3))
        assert match.usable, match.reason
        pulls.append((match.local - [0.8, -0.5, 0.3]) / np.sqrt(np.diag(match.covariance)))
    assert 0.7 < np.sqrt(np.mean(np.square(pulls))) < 1.35


def test_single_surfaces_without_match_have_a_reason() -> None:
    cloud = Terrain(1).cloud(0, 20_000, NOISE_M)
    other = FixedSurface(SURFACE, Surface(spc_surface(8)))
    assert match_returns("M", returns_of(cloud), other).reason
    few = match_returns("M", returns_of(cloud[cloud[:, 0] > 12.0]), other)
    assert "cover only" in few.reason
    assert np.isnan(few.displacement).all()
