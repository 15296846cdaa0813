"""What every test may ask for."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import pytest
import typer.testing
from hypothesis import settings

# Test processes that each start as many threads of BLAS as there are cores wait for each other: one
# test took ten times as long. The first import of NumPy reads this, and child processes inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# No test is timed: on a busy machine any example may take longer than Hypothesis allows.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

# CliRunner builds every command anew for every call, which takes longer than most of the calls.
typer.testing._get_command = cache(typer.testing._get_command)

TESTS = Path(__file__).resolve().parent
SHARED = TESTS.parents[1] / "shared" / "data"
# Files that take long are started first: the last ones are short, and all cores end together. Where
# no compiled kernels are kept yet, the first two compile most of them, each other ones; a file that
# shares many with one of them comes later, so that hardly any is compiled twice at the same time.
# Those of the service wait half of their time for processes: they lie between those that compute.
LONG = (
    "spcola/heights/test_solver.py",
    "bad_input/test_results.py",
    "fusion/scaling/test_iteration.py",
    "lidar/adjustment/test_normal_equations.py",
    "fusion/scaling/test_ground.py",
    "fusion/truth/test_demo.py",
    "bad_input/test_inputs.py",
    "fusion/client/test_faults.py",
    "fusion/stages/test_register_stage.py",
    "fusion/service/work/test_worker.py",
    "fusion/stages/test_register_by_images.py",
    "fusion/service/page/test_work.py",
    "bad_input/test_processes.py",
    "fusion/scaling/test_misplacement.py",
    "fusion/service/faults/test_postgresql.py",
    "fusion/cli/test_cli.py",
    "fusion/service/page/test_map.py",
    "fusion/registration/test_direct.py",
    "fusion/service/store/test_restore_while_it_runs.py",
    "fusion/registration/test_search.py",
    "fusion/service/page/test_views.py",
    "fusion/scene/geolocation/test_locating.py",
    "fusion/service/faults/test_kills.py",
    "spcola/imagematching/test_image_match.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the tests of long files first; each file keeps its order."""
    place = {TESTS / name: number for number, name in enumerate(LONG)}
    items.sort(key=lambda item: place.get(item.path, len(LONG)))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real data next to the checkout; the test is skipped if it is absent."""
    if not SHARED.is_dir():
        pytest.skip("no ../shared/data next to the checkout: the real data are missing")
    return SHARED
