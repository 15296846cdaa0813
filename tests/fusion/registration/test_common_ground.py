"""Relief that lidar and SPC have in common, against what chance gives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import fft

from fusion.registration.judging import ReliefPair, common_relief
from fusion.registration.judging.common_ground import SHOWN
from spcola.arrays import FloatArray

SIZE, REACH = 55, 4


def terrain(seed: int, *, steepness: float = 1.8) -> FloatArray:
    """Self-affine relief of standard deviation 1 m on a round body, with room to be shifted."""
    draw = np.random.default_rng(seed)
    size = SIZE + 2 * REACH
    rows, columns = fft.fftfreq(size)[:, None], fft.rfftfreq(size)[None, :]
    wavenumber = np.hypot(rows, columns)
    wavenumber[0, 0] = np.inf
    white = fft.rfft2(draw.normal(size=(size, size)))
    relief = fft.irfft2(white * wavenumber**-steepness, (size, size))
    y, x = np.mgrid[:size, :size] - size / 2
    return relief / relief.std() - (x**2 + y**2) / 200.0


def pair(
    seed: int, other: int, *, noise: float = 0.3, shift: tuple[int, int] = (0, 0)
) -> ReliefPair:
    """SPC of one terrain with noise, and lidar of another one that has to be moved by `shift`."""
    draw = np.random.default_rng(seed + 10_000)
    inner = slice(REACH, REACH + SIZE)
    x, y = shift
    lidar = terrain(other)[REACH + y : REACH + y + SIZE, REACH + x : REACH + x + SIZE]
    spc = terrain(seed)[inner, inner] + noise * draw.normal(size=(SIZE, SIZE))
    return ReliefPair(lidar.copy(), spc, np.array(shift, dtype=float), REACH)


def test_one_ground_is_known_as_such_at_the_place_where_it_is() -> None:
    found = common_relief([pair(k, k, shift=(2, -1)) for k in range(8)])
    assert found.share == 1.0
    assert found.z_score.min() > 2 * SHOWN
    assert found.apart.max() < 1.0


def test_the_same_ground_at_a_place_other_than_that_of_the_transform_is_not_shown() -> None:
    placed = [pair(k, k, shift=(3, 0)) for k in range(8)]
    found = common_relief([one._replace(shift=np.array([-3.0, 0.0])) for one in placed])
    assert found.z_score.min() > SHOWN
    assert found.share == 0.0
    unknown = common_relief([one._replace(shift=np.full(2, np.nan)) for one in placed])
    assert unknown.share == 1.0


@pytest.mark.parametrize("count", [1, 8])
def test_unrelated_ground_is_hardly_ever_taken_for_the_same(count: int) -> None:
    """Less than 1 % of single mapolas are; a share of a half never is."""
    shares = []
    for trial in range(80 // count):
        first = 1000 + 100 * trial
        placed = [pair(first + k, first + 50 + k) for k in range(count)]
        shares.append(common_relief(placed).share)
    assert np.mean(shares) < 0.01
    assert max(shares) < 0.5 or count == 1


def test_mirrored_and_turned_ground_is_not_the_same() -> None:
    placed = [pair(k, k) for k in range(8)]
    mirrored = [one._replace(lidar=one.lidar[:, ::-1].copy()) for one in placed]
    turned = [one._replace(lidar=np.rot90(one.lidar).copy()) for one in placed]
    assert common_relief(mirrored).share == 0.0
    assert common_relief(turned).share == 0.0


def test_half_of_the_cells_missing_still_show_the_ground() -> None:
    placed = [pair(k, k, shift=(1, 1)) for k in range(8)]
    holes = np.random.default_rng(1).uniform(size=(8, SIZE, SIZE)) < 0.5
    thinned = [
        one._replace(lidar=np.where(hole, np.nan, one.lidar))
        for one, hole in zip(placed, holes, strict=True)
    ]
    assert common_relief(thinned).share == 1.0


def test_ground_without_relief_shows_nothing() -> None:
    y, x = np.mgrid[:SIZE, :SIZE] - SIZE / 2
    ball = -(x**2 + y**2) / 200.0
    found = common_relief([ReliefPair(ball, ball, np.zeros(2), REACH)] * 4)
    assert found.compared == 0
    assert np.isnan(found.share)


def test_noise_of_a_smooth_body_is_no_relief() -> None:
    """Where nothing stands above the stated noise nothing is compared."""
    y, x = np.mgrid[:SIZE, :SIZE] - SIZE / 2
    draw = np.random.default_rng(3)
    placed = []
    for _ in range(6):
        lidar, spc = 0.05 * draw.normal(size=(2, SIZE, SIZE)) - (x**2 + y**2) / 200.0
        placed.append(ReliefPair(lidar, spc, np.zeros(2), REACH, noise=0.07))
    assert common_relief(placed).compared == 0
    assert common_relief([one._replace(noise=0.0) for one in placed]).share == 0.0
