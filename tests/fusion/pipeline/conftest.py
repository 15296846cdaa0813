"""Stages that copy files, over a small workspace."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from fusion.estimation.verdict import Verdict
from fusion.pipeline import Pipeline, StageContext, StageResult
from fusion.runtime import ThreadExecutor
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings, Table
from fusion.workspace.settings.processing import FuseSettings, MapolaSettings, RegisterSettings
from spcola import atomic


@dataclass
class Copy:
    """A stage that copies files, in capitals, and counts its runs."""

    name: str
    source: str
    target: str
    tables: tuple[type[Table], ...] = ()
    version: int = 1
    runs: int = 0
    act: Callable[[StageContext], None] = field(default=lambda _: None)
    needs: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    verdict: Verdict = field(default_factory=Verdict)

    def compares_lidar(self, settings: Settings) -> bool:
        return False

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        return "" if self.inputs(workspace, settings) else f"nothing in {self.source}"

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        return sorted((workspace.root / self.source).glob("*.txt"))

    def run(self, context: StageContext) -> StageResult:
        self.runs += 1
        outputs = []
        for path in self.inputs(context.workspace, context.settings):
            made = context.workspace.root / self.target / path.name
            made.parent.mkdir(exist_ok=True)
            atomic.write_text(made, path.read_text().upper())
            outputs.append(made)
        self.act(context)
        return StageResult(
            tuple(outputs),
            {
                "files": len(outputs),
                "nan": float("nan"),
                "array": np.eye(2),
                **self.verdict.as_json(),
            },
        )


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    made = Workspace.create(tmp_path / "ws", Settings())
    (made.root / "raw").mkdir()
    (made.root / "raw" / "a.txt").write_text("alpha")
    (made.root / "raw" / "b.txt").write_text("beta")
    return made


@pytest.fixture
def stages() -> list[Copy]:
    return [
        Copy("one", "raw", "first", (MapolaSettings,)),
        Copy("two", "first", "second", (RegisterSettings,)),
        Copy("three", "second", "third", (FuseSettings,)),
    ]


def pipeline(
    workspace: Workspace, stages: list[Copy], settings: Settings | None = None
) -> Pipeline:
    return Pipeline(workspace, settings or Settings(), stages, ThreadExecutor(1))


def runs(stages: list[Copy]) -> list[int]:
    return [stage.runs for stage in stages]
