"""A short seed set of `scripts/bench/fuzz.py`: mutated files are read, or refused in one line."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "scripts" / "bench"))

import fuzz

INPUTS = 40


@pytest.mark.parametrize("kind", fuzz.KINDS)
def test_mutated_files_are_refused_in_one_line_or_read(kind: str) -> None:
    tally = fuzz.read_all(kind, range(INPUTS), seed=1, child=False)
    assert not tally.failures
    # Mutations that change nothing, or are all refused at the first byte, would test nothing.
    assert tally.counts["refused"] >= INPUTS // 10
    assert tally.counts["accepted"] >= 1


def test_an_input_can_be_made_again() -> None:
    sample = fuzz.KINDS["table"]
    good = b"x_m,y_m,z_m\n1,2,3\n4,5,6\n"
    made = [fuzz.input_of(sample, good, "table", 1, number) for number in range(20)]
    assert made == [fuzz.input_of(sample, good, "table", 1, number) for number in range(20)]
    assert len(set(made)) > 10


def test_what_should_not_be_is_counted(tmp_path: Path) -> None:
    """The bench itself: an unexpected error, a death and a hang are each seen."""
    sample = fuzz.KINDS["list"]

    def broken(path: Path) -> None:
        raise KeyError(path.name)

    tally = fuzz.Tally()
    path = tmp_path / "a"
    path.write_bytes(b"a")
    tally.add(3, *fuzz.outcome_of(replace(sample, read=broken), path))
    tally.add(4, "hangs", "signal 27")
    assert tally.counts == {"unexpected": 1, "hangs": 1}
    assert list(tally.failures.values()) == [[3], [4]]
