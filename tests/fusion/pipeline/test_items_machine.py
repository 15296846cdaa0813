"""Any order of changes, whole runs, subsets and interruptions, on threads and on a cluster.

After a whole run the results are those of a fresh run, and nothing is computed twice.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest
from distributed import LocalCluster
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from fusion.pipeline import Pipeline, Stage, StageContext, StageResult, Subset, with_kept
from fusion.runtime import ClusterExecutor, Executor, ThreadExecutor
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from spcola import atomic
from spcola.math import Similarity

NAMES = tuple("abcdef")
COMPUTED: list[tuple[str, float]] = []
FAILS: set[str] = set()


@dataclass(frozen=True)
class Made:
    name: str
    text: str


def enlarged(name: str, scale: float) -> Similarity:
    """The work on an item: pure, and counted."""
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
        return sorted((workspace.root / "in").iterdir())

    def run(self, context: StageContext) -> StageResult:
        workspace, folder = context.workspace, context.workspace.home / "out"
        given = {path.stem: path for path in self.inputs(workspace, context.settings)}
        chosen, items = context.chosen(given), context.items

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


class Runs(RuleBasedStateMachine):
    """A workspace that is changed and run; `left` is what its results must be."""

    executors: ClassVar[dict[str, Executor]] = {}

    @initialize(values=st.tuples(*[st.integers(1, 5)] * len(NAMES)))
    def start(self, values: tuple[int, ...]) -> None:
        self.folder = tempfile.TemporaryDirectory()
        self.workspace = Workspace.create(Path(self.folder.name) / "ws", Settings())
        (self.workspace.root / "in").mkdir()
        self.values: dict[str, float] = {}
        self.left: dict[str, str] = {}
        self.known: set[tuple[str, float]] = set()
        FAILS.clear()
        for name, value in zip(NAMES, values, strict=True):
            self.change(name, value)

    @rule(name=st.sampled_from(NAMES), value=st.integers(1, 5))
    def change(self, name: str, value: int) -> None:
        self.values[name] = float(value)
        (self.workspace.root / "in" / name).write_text(str(float(value)))

    @rule(on=st.sampled_from(["threads", "cluster"]))
    def run_all(self, on: str) -> None:
        self._run(on, Subset())
        self.left = {name: repr(2.0 * value) for name, value in self.values.items()}
        # Items without use are gone: only those of these values are known from now on.
        self.known = set(self.values.items())
        self._check()

    @rule(on=st.sampled_from(["threads", "cluster"]), names=st.sets(st.sampled_from(NAMES)))
    def run_some(self, on: str, names: set[str]) -> None:
        self._run(on, Subset.of(names))
        for name in names or NAMES:
            self.left[name] = repr(2.0 * self.values[name])
        self._check()
        self.known |= {(name, self.values[name]) for name in names or NAMES}
        if self.left != {name: repr(2.0 * value) for name, value in self.values.items()}:
            due = Pipeline(self.workspace, Settings(), [Enlarge()]).states()["enlarge"]
            assert due.startswith("due")

    @rule(broken=st.sampled_from(NAMES))
    def fail_in_the_middle(self, broken: str) -> None:
        FAILS.add(broken)
        try:
            self._run("threads", Subset())
        except RuntimeError:
            self.known |= set(COMPUTED)
        else:
            # Nothing had to be computed of it.
            self.left = {name: repr(2.0 * value) for name, value in self.values.items()}
            self.known = set(self.values.items())
        finally:
            FAILS.clear()
        self._check()

    def _run(self, on: str, subset: Subset) -> None:
        COMPUTED.clear()
        stages = [Enlarge()]
        Pipeline(self.workspace, Settings(), stages, self.executors[on], subset=subset).run_stage(
            "enlarge"
        )
        assert len(COMPUTED) == len(set(COMPUTED))
        assert not set(COMPUTED) & self.known, "computed again"

    def _check(self) -> None:
        folder = self.workspace.home / "out"
        there = {p.name: p.read_text() for p in folder.iterdir()} if folder.is_dir() else {}
        together = json.loads(there.pop("all", "{}"))
        assert there == self.left == together
        assert list(together) == [name for name in NAMES if name in together]

    def teardown(self) -> None:
        self.folder.cleanup()


@pytest.fixture
def executors() -> Iterator[None]:
    with LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0"
    ) as cluster:
        remote = ClusterExecutor(str(cluster.scheduler_address))
        Runs.executors = {"threads": ThreadExecutor(2), "cluster": remote}
        yield
        remote.close()


@pytest.mark.usefixtures("executors")
def test_runs_in_any_order_give_what_a_fresh_run_gives() -> None:
    Runs.TestCase.settings = settings(
        max_examples=25, stateful_step_count=12, deadline=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    Runs.TestCase("runTest").runTest()
