"""What every test may ask for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Test processes that each start as many threads of BLAS as there are cores wait for each other: one
# test took ten times as long. The first import of NumPy reads this, and child processes inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# No test is timed: on a busy machine any example may take longer than Hypothesis allows.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real data beside the checkout; the test is skipped where it is absent."""
    if not SHARED.is_dir():
        pytest.skip("no ../shared/data beside the checkout: the real data are not here")
    return SHARED
