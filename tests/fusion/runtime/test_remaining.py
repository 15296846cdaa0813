"""The time that work still takes is known within a factor of 1.5 after its first tenth."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from fusion.pipeline.items import ItemStore
from fusion.runtime.remaining import RemainingTime, Timed


def forecast(seconds: np.ndarray, sizes: np.ndarray, workers: int, done: int) -> float:
    found = RemainingTime(sizes.tolist(), workers)
    for each in seconds[:done]:
        found.add(float(each))
    return found.seconds


CASES = (
    "alike",
    "by size",
    "compiled",
    "small ones cost as much",
    "kept first",
    "kept among",
    "no work",
)


@pytest.mark.parametrize("workers", [1, 2, 8])
@pytest.mark.parametrize("case", CASES)
def test_the_rest_is_known_after_a_tenth(workers: int, case: str) -> None:
    draw = np.random.default_rng([workers, len(case)])
    sizes = draw.lognormal(0.0, 1.0, 400) if case == "by size" else np.ones(400)
    seconds = 0.3 * sizes * draw.lognormal(0.0, 0.2, 400)
    done = 40
    if case == "compiled":
        seconds[:workers] += 30.0
    elif case == "small ones cost as much":
        sizes[workers : 2 * workers] = 1e-4
    elif case == "no work":
        sizes[:30], seconds[:30] = 0.0, 1.0
    expected = seconds[done:].sum() / workers
    if case == "kept first":
        seconds[:20] = np.nan
    elif case == "kept among":
        seconds[:40:2] = np.nan
    assert 1 / 1.5 < forecast(seconds, sizes, workers, done) / expected < 1.5


def test_before_anything_is_known_nothing_is_said() -> None:
    found = RemainingTime([1.0, 1.0, 1.0], 2)
    assert math.isnan(found.seconds)
    for _ in range(2):
        found.add(5.0)
    assert math.isnan(found.seconds)
    found.add(1.0)
    assert found.seconds == 0.0


def test_the_time_of_a_kept_result_is_unknown(tmp_path: Path) -> None:
    store = ItemStore(tmp_path, "1")
    timed = Timed(lambda values: [store.result(math.sqrt, value) for value in values])
    spent = [timed(items)[1] for items in ([4.0], [4.0], [4.0, 9.0], [])]
    assert [math.isnan(one.seconds) for one in spent] == [False, True, False, False]
    assert [one.is_kept for one in spent] == [True, False, True, False]
