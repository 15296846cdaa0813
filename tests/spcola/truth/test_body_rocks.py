"""Rocks that are not stored: numbers and sizes by the power law, and none cut anywhere."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.errors import SettingsError
from spcola.truth.body import BOULDER, BodySettings, TruthBody
from spcola.truth.body.cells import face_directions, face_place
from spcola.truth.body.relief import PowerLaw, SmoothSite
from spcola.truth.body.rocks import (
    Rocks,
    _metric,
    has_rock,
    make_rocks,
    raise_rocks,
    rock_chance,
    rock_diameter,
    rock_place,
    rock_shape,
    rock_word,
)

LAW = PowerLaw(1.0e4, 2.7, 0.4, 10.0)


@pytest.fixture(scope="module")
def rocks() -> Rocks:
    return make_rocks(LAW, 0.05, 245.0, 1234, SmoothSite())


def _near(middle: np.ndarray, count: int, width: float, seed: int = 0) -> np.ndarray:
    d = middle + width / 245.0 * np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def _tops(rocks: Rocks, d: np.ndarray) -> np.ndarray:
    top = np.zeros(len(d))
    raise_rocks(rocks, d, top, len(d))
    return top


def _cells_of(rocks: Rocks, octave: int, face: int, rows: range, columns: range):
    """Yield row, column and hash of the cells that have a rock."""
    cells = int(rocks.cells[octave])
    for row in rows:
        for column in columns:
            word = np.uint32(rock_word(rocks.seed, octave, face, row, column))
            chance = rocks.chance[octave] * rock_chance(rocks.weight, face, row, column, cells)
            if has_rock(word, chance):
                yield row, column, word


def test_number_and_sizes_follow_the_power_law() -> None:
    even = PowerLaw(1.0e4, 2.7, 0.4, 10.0, contrast=0.0)
    rocks = make_rocks(even, 0.05, 245.0, 77, None)
    nodes = face_directions(np.array([-0.2, 0.1]))[2] * 245.0
    area = np.linalg.norm(np.cross(nodes[1, 1] - nodes[0, 0], nodes[0, 1] - nodes[1, 0])) / 2.0
    for octave, largest in enumerate((0.4, 0.2, 0.1)):
        cells = int(rocks.cells[octave])
        # A part of the face's middle, of which only some columns are counted.
        rows = range(int(0.4 * cells), int(0.55 * cells))
        columns = range(int(0.4 * cells), int(0.55 * cells), 1 + cells // 400)
        found = list(_cells_of(rocks, octave, 2, rows, columns))
        sizes = [rock_diameter(word, 0.5 * largest, rocks.sizes) for _, _, word in found]
        share = len(rows) * len(columns) / (0.15 * cells) ** 2
        expected = 1e-2 * ((largest / 2) ** -2.7 - largest**-2.7) * area * share
        # Each cell has one or none: the variance is less than Poisson's.
        assert len(found) == pytest.approx(expected, abs=3.0 * np.sqrt(expected) + 0.01 * expected)
        trial = np.linspace(1.0, 5.0, 2001)
        width = (largest / 2) ** -trial - largest**-trial
        likelihood = np.log(trial / width) - (trial + 1.0) * np.mean(np.log(sizes))
        # Over one octave the slope is known to 1/(√N · the spread of ln D over it).
        spread = np.std(np.log(sizes))
        slope = trial[np.argmax(likelihood)]
        assert slope == pytest.approx(2.7, abs=3.0 / (spread * np.sqrt(len(sizes))))


def test_four_cells_are_enough(rocks: Rocks) -> None:
    for middle in ([-1.0, 0.1, 0.05], [-0.6, -0.62, -0.61], [-0.7, 0.2, -0.69]):
        d = _near(np.array(middle) / np.linalg.norm(middle), 60, 30.0)
        found = _tops(rocks, d)
        for n, direction in enumerate(d):
            face, s, t = face_place(*direction)
            xs, xt, yt = _metric(245.0, s, t)
            top = 0.0
            for octave in range(3):
                cells = int(rocks.cells[octave])
                x, y = (s + 1.0) * 0.5 * cells, (t + 1.0) * 0.5 * cells
                rows = range(int(y) - 2, int(y) + 3)
                columns = range(int(x) - 2, int(x) + 3)
                for row, column, word in _cells_of(rocks, octave, face, rows, columns):
                    a, b = rock_place(word)
                    ds, dt = (x - column - a) * 2.0 / cells, (y - row - b) * 2.0 / cells
                    place = (xs * ds + xt * dt, yt * dt)
                    diameter = rock_diameter(word, rocks.largest[octave] / 2.0, rocks.sizes)
                    top = max(top, rock_shape(word, diameter, rocks.turns, place))
            assert found[n] == pytest.approx(top, abs=1e-12)


def test_steps_on_a_face_are_metres() -> None:
    for s, t in ((0.1, -0.3), (-0.9, 0.95), (0.5, 0.5)):
        step = 1e-6
        here, aside, above = (
            face_directions(np.array([b, a]))[0, 0, 1] for a, b in ((s, t), (s + step, t), (s, t))
        )
        above = face_directions(np.array([t + step, s]))[0, 0, 1]
        xs, xt, yt = _metric(245.0, s, t)
        assert 245.0 * np.linalg.norm(aside - here) / step == pytest.approx(xs, rel=1e-4)
        assert 245.0 * np.linalg.norm(above - here) / step == pytest.approx(
            np.hypot(xt, yt), rel=1e-4
        )
        cosine = (aside - here) @ (above - here) / (step / 245.0) ** 2
        assert cosine == pytest.approx(xs * xt, rel=1e-3, abs=1e-2 * xs * xs)


def test_rocks_are_whole(rocks: Rocks) -> None:
    for middle in ([-1.0, 1.0, 0.02], [-1.0, 0.0, 0.0], [-1.0, 1.0, 1.0]):
        centre = np.array(middle) / np.linalg.norm(middle)
        along = np.linspace(-2.0, 2.0, 40_001)[:, None] * np.array([0.6, 0.64, 0.48]) / 245.0
        line = centre + along
        line /= np.linalg.norm(line, axis=1, keepdims=True)
        tops = _tops(rocks, line)
        # Sides of at most 64°, over steps of 0.1 mm at most; no cliff.
        assert np.abs(np.diff(tops)).max() < 2.2e-4


def test_rocks_cover_what_they_should(rocks: Rocks) -> None:
    shares = []
    for middle in ([1.0, 0.2, 0.3], [0.0, 1.0, 0.2], [-1.0, 0.2, 0.3]):
        centre = np.array(middle) / np.linalg.norm(middle)
        tops = _tops(rocks, _near(centre, 40_000, 60.0))
        shares.append(np.mean(tops > 0.0))
        # Ellipses of mean axes ratio 0.8, of numbers n(D) dD = 2.7e-2 D^-3.7 dD per m².
        cover = 0.8 * np.pi / 4.0 * 2.7e-2 / 0.7 * (0.05**-0.7 - 0.4**-0.7)
        cover *= 1.0 - 0.8 * centre[0]
        assert shares[-1] == pytest.approx(1.0 - np.exp(-cover), rel=0.08)
        assert 0.05 < tops.max() < 0.12
    assert shares[0] < shares[1] < shares[2]
    on_site = _tops(rocks, _near(SmoothSite().direction, 40_000, 25.0))
    assert np.mean(on_site > 0.0) < 0.02


def test_a_body_with_rocks_is_the_body_with_them_on_it() -> None:
    plain, rocky = (TruthBody(BodySettings(smallest_rock=s)) for s in (None, 0.05))
    d = _near(np.array([-0.8, 0.5, 0.33]), 20_000, 40.0)
    added = rocky.radius(d) - plain.radius(d)
    assert added.min() == 0.0
    assert 0.02 < added.max() < 0.13
    flagged = rocky.terrain(d, smallest=0.05) & BOULDER > 0
    assert np.all(flagged[added > 0.0])
    assert np.mean(flagged) > 1.5 * np.mean(rocky.terrain(d, smallest=0.1) & BOULDER > 0)
    np.testing.assert_array_equal(rocky.terrain(d, smallest=0.4), plain.terrain(d, smallest=0.4))
    hits = rocky.first_hits(600.0 * d[:2000], -d[:2000])
    ground = np.linalg.norm(hits.points, axis=1) - rocky.radius(hits.points)
    assert np.abs(ground).max() < 1e-9
    np.testing.assert_allclose(hits.distance, 600.0 - rocky.radius(d[:2000]), rtol=0, atol=1e-9)


def test_rocks_of_dust_are_refused() -> None:
    with pytest.raises(SettingsError):
        BodySettings(smallest_rock=0.001)
