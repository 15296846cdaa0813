"""Any order of changes, whole runs, subsets, failures and kills, on threads and on a cluster.

In several solutions, each made from another. After a whole run the results are those of a fresh
run, nothing is computed twice, and a kill loses at most the item of each worker.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from distributed import LocalCluster
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from fusion.pipeline import Pipeline, Stage, StageContext, StageResult, Subset, with_kept
from fusion.pipeline.solutions import MadeBy, making_solution, use_solution
from fusion.runtime import ClusterExecutor, Executor, ThreadExecutor
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from spcola import atomic
from spcola.math import Similarity

NAMES = tuple("abcdef")
COMPUTED: list[tuple[str, float]] = []
FAILS: set[str] = set()
KILLS: set[str] = set()
# Where a run that is going to be killed lists the items that it begins.
BEGUN: list[Path] = []
WORKERS = 2
# So far apart on the equator, 60 degrees, lie the items.
CENTERS = {
    name: 100.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
    for name, angle in zip(NAMES, np.arange(len(NAMES)) * np.pi / 3, strict=True)
}
SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(["fusion.pipeline.solutions", "distributed", "hypothesis.stateful"])


@dataclass(frozen=True)
class Made:
    name: str
    text: str


def enlarged(name: str, scale: float) -> Similarity:
    """The work on an item: pure, and counted."""
    for path in BEGUN:
        with path.open("a") as stream:
            stream.write(json.dumps([name, scale]) + "\n")
    if name in KILLS:
        os.kill(os.getpid(), signal.SIGKILL)
    if name in FAILS:
        raise RuntimeError(name)
    COMPUTED.append((name, scale))
    return Similarity(scale=2.0 * scale)


class Enlarge(Stage):
    """Numbers in files → doubled numbers, one file each, and one file of all."""

    name = "enlarge"
    version = 1
    places = ("out",)

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        return sorted((workspace.home / "MAPFILES").iterdir())

    def run(self, context: StageContext) -> StageResult:
        workspace, folder = context.workspace, context.workspace.home / "out"
        given = {path.stem: path for path in self.inputs(workspace, context.settings)}
        chosen, items = context.chosen(given, CENTERS), context.items

        def one(name: str) -> Made:
            found = items.result(enlarged, name, float(given[name].read_text()))
            return Made(name, repr(found.scale))

        def kept(name: str) -> Made | None:
            path = folder / name
            return Made(name, path.read_text()) if path.is_file() else None

        made = context.stream("enlarge", one, chosen, sizes=[1.0] * len(chosen))
        results = list(with_kept(given, chosen, made, kept))
        folder.mkdir(exist_ok=True)
        for each in results:
            atomic.write_text(folder / each.name, each.text)
        atomic.write_text(folder / "all", json.dumps({each.name: each.text for each in results}))
        return StageResult(tuple(folder / name for name in ("all", *(r.name for r in results))))


def killed_run(root: Path, solution: str, broken: str, begun: Path) -> None:
    """Run the stage in a process of its own until an item kills it."""
    KILLS.add(broken)
    BEGUN.append(begun)
    workspace = Workspace.open(root, solution)
    Pipeline(workspace, Settings(), [Enlarge()], ThreadExecutor(WORKERS)).run_stage("enlarge")


class Solution:
    """What one solution must hold.

    Attributes
    ----------
    values : dict
        The inputs.
    left : dict
        The results of its last runs.
    known : set
        Items that must not be computed again.
    begun : set
        Items that a killed run began.
    """

    def __init__(self, values: dict[str, float]) -> None:
        self.values = values
        self.left: dict[str, str] = {}
        self.known: set[tuple[str, float]] = set()
        self.begun: set[tuple[str, float]] = set()

    def results(self) -> dict[str, str]:
        return {name: repr(2.0 * value) for name, value in self.values.items()}

    def finish(self) -> None:
        """Note a whole run: items without use are gone."""
        self.left, self.known = self.results(), set(self.values.items())


ON = st.sampled_from(["threads", "cluster"])
WHICH = st.integers(0, 2)
NAME = st.sampled_from(NAMES)


class Runs(RuleBasedStateMachine):
    """A workspace whose solutions are changed and run."""

    executors: ClassVar[dict[str, Executor]] = {}

    @initialize(values=st.tuples(*[st.integers(1, 5)] * len(NAMES)))
    def start(self, values: tuple[int, ...]) -> None:
        self.folder = tempfile.TemporaryDirectory()
        self.root = Workspace.create(Path(self.folder.name) / "ws", Settings()).root
        FAILS.clear()
        self.solutions = {"imported": Solution(dict(zip(NAMES, map(float, values), strict=True)))}
        self.used, self.fresh = "imported", 10.0
        for name, value in self.solutions["imported"].values.items():
            atomic.write_text(self.root / "MAPFILES" / name, str(value))

    def one(self, which: int) -> tuple[Workspace, Solution]:
        """Return a solution; of the one in use the name is not given."""
        name = list(self.solutions)[which % len(self.solutions)]
        workspace = Workspace.open(self.root, "" if name == self.used else name)
        assert workspace.solution == name
        return workspace, self.solutions[name]

    @rule(which=WHICH, name=NAME, value=st.integers(1, 5))
    def change(self, which: int, name: str, value: int) -> None:
        self._set(*self.one(which), name, float(value))

    def _set(self, workspace: Workspace, solution: Solution, name: str, value: float) -> None:
        solution.values[name] = value
        atomic.write_text(workspace.home / "MAPFILES" / name, str(value))

    @rule(which=WHICH, name=NAME, value=st.integers(1, 5))
    def make(self, which: int, name: str, value: int) -> None:
        """Make a solution with another value of one item, and use it."""
        workspace, solution = self.one(which)
        if len(self.solutions) > 2:
            return
        made = f"made-{len(self.solutions)}"
        with making_solution(workspace, made, MadeBy("test", {}, {}, {})) as making:
            atomic.write_text(making / "MAPFILES" / name, str(float(value)))
        self.solutions[made] = Solution({**solution.values, name: float(value)})
        self.use(len(self.solutions) - 1)

    @rule(which=WHICH)
    def use(self, which: int) -> None:
        self.used = list(self.solutions)[which % len(self.solutions)]
        use_solution(Workspace.open(self.root), self.used)

    @rule(which=WHICH, on=ON)
    def run_all(self, which: int, on: str) -> None:
        workspace, solution = self.one(which)
        self._run(workspace, solution, on, Subset())
        solution.finish()
        self._check()

    @rule(which=WHICH, on=ON, names=st.sets(NAME, min_size=1))
    def run_some(self, which: int, on: str, names: set[str]) -> None:
        self._run_subset(which, on, Subset.of(names), names)

    @rule(which=WHICH, on=ON, place=st.integers(0, len(NAMES) - 1), reach=st.integers(0, 1))
    def run_within(self, which: int, on: str, place: int, reach: int) -> None:
        names = {NAMES[(place + k) % len(NAMES)] for k in range(-reach, reach + 1)}
        within = f"0,{60 * place},{30 + 100 * reach}"
        self._run_subset(which, on, Subset.of((), within), names)

    @rule(which=WHICH, broken=NAME)
    def fail_in_the_middle(self, which: int, broken: str) -> None:
        workspace, solution = self.one(which)
        FAILS.add(broken)
        try:
            self._run(workspace, solution, "threads", Subset())
        except RuntimeError:
            solution.known |= set(COMPUTED)
        else:
            # Nothing had to be computed of it.
            solution.finish()
        finally:
            FAILS.clear()
        self._check()

    @rule(which=WHICH, broken=NAME)
    def kill_in_the_middle(self, which: int, broken: str) -> None:
        workspace, solution = self.one(which)
        begun = self.root / "begun"
        begun.write_text("")
        # A value that nothing was computed of yet.
        self.fresh += 1.0
        self._set(workspace, solution, broken, self.fresh)
        arguments = (self.root, workspace.solution, broken, begun)
        process = SERVER.Process(target=killed_run, args=arguments)
        process.start()
        process.join()
        items = {(name, value) for name, value in map(json.loads, begun.read_text().splitlines())}
        assert not items & solution.known, "computed again"
        assert process.exitcode == -signal.SIGKILL
        self._check_begun(solution, items)
        solution.begun = items
        self._check()

    def _run_subset(self, which: int, on: str, subset: Subset, names: set[str]) -> None:
        workspace, solution = self.one(which)
        self._run(workspace, solution, on, subset)
        for name in names:
            solution.left[name] = repr(2.0 * solution.values[name])
        self._check()
        solution.known |= {(name, solution.values[name]) for name in names}
        if solution.left != solution.results():
            assert Pipeline(workspace, Settings(), [Enlarge()]).states()["enlarge"][:3] == "due"

    def _run(self, workspace: Workspace, solution: Solution, on: str, subset: Subset) -> None:
        COMPUTED.clear()
        stages = [Enlarge()]
        Pipeline(workspace, Settings(), stages, self.executors[on], subset=subset).run_stage(
            "enlarge"
        )
        assert len(COMPUTED) == len(set(COMPUTED))
        assert not set(COMPUTED) & solution.known, "computed again"
        self._check_begun(solution, set(COMPUTED))

    def _check_begun(self, solution: Solution, computed: set[tuple[str, float]]) -> None:
        """Check that a kill lost no more than what its workers were at."""
        assert len(computed & solution.begun) <= WORKERS
        solution.begun = set()

    def _check(self) -> None:
        for which, solution in enumerate(self.solutions.values()):
            folder = self.one(which)[0].home / "out"
            there = {p.name: p.read_text() for p in folder.iterdir()} if folder.is_dir() else {}
            together = json.loads(there.pop("all", "{}"))
            assert there == solution.left == together
            assert list(together) == [name for name in NAMES if name in together]

    def teardown(self) -> None:
        self.folder.cleanup()


@pytest.fixture
def executors() -> Iterator[None]:
    with LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0"
    ) as cluster:
        remote = ClusterExecutor(str(cluster.scheduler_address))
        Runs.executors = {"threads": ThreadExecutor(WORKERS), "cluster": remote}
        yield
        remote.close()


@pytest.mark.usefixtures("executors")
def test_runs_in_any_order_give_what_a_fresh_run_gives() -> None:
    Runs.TestCase.settings = settings(
        max_examples=15, stateful_step_count=14, deadline=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    Runs.TestCase("runTest").runTest()
