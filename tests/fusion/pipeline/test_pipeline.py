"""The pipeline and its catalogue: skipping, re-running, resuming, and loss of the catalogue."""

from __future__ import annotations

import fcntl
import json
import os
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from fusion.pipeline import Pipeline, StageContext, StageResult
from fusion.pipeline.catalog import Catalog
from fusion.pipeline.catalog.catalog import CATALOG_FILE
from fusion.pipeline.pipeline import SCRATCH_FOLDER
from fusion.runtime import ThreadExecutor
from fusion.runtime.folders import LOCK_FILE
from fusion.verdict import Code, Finding, Severity, Verdict
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings, Table
from fusion.workspace.settings.processing import FuseSettings, MapolaSettings, RegisterSettings
from spcola import atomic
from spcola.errors import SettingsError, WorkspaceError


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


def test_what_is_up_to_date_is_skipped(workspace: Workspace, stages: list[Copy]) -> None:
    first = pipeline(workspace, stages).run()
    assert [run.state for run in first] == ["ran"] * 3
    assert (workspace.root / "third" / "a.txt").read_text() == "ALPHA"
    second = pipeline(workspace, stages).run()
    assert [run.state for run in second] == ["up to date"] * 3
    assert runs(stages) == [1, 1, 1]
    assert second[0].summary["files"] == 2


def test_stages_run_linear_algebra_on_one_thread(workspace: Workspace, stages: list[Copy]) -> None:
    """More of them sum in another order: a result would depend on the number of cores."""
    found: list[int] = []

    def look(context: StageContext) -> None:
        found.extend(blas_threads())
        list(context.executor.stream(lambda _: found.extend(blas_threads()), range(2)))
        found.extend(blas_threads())

    stages[0].act = look
    with threadpool_limits(limits=2, user_api="blas"):
        pipeline(workspace, stages).run()
        assert set(blas_threads()) == {2}
        pipeline(workspace, stages).run_stage("one", force=True)
        assert set(blas_threads()) == {2}
    assert len(found) >= 8
    assert set(found) == {1}


def blas_threads() -> list[int]:
    return [one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"]


def test_force_runs_all(workspace: Workspace, stages: list[Copy]) -> None:
    pipeline(workspace, stages).run()
    pipeline(workspace, stages).run(force=True)
    assert runs(stages) == [2, 2, 2]


def test_a_changed_setting_reruns_what_depends_on_it(
    workspace: Workspace, stages: list[Copy]
) -> None:
    pipeline(workspace, stages).run()
    changed = Settings().with_table("register", capture_m=7.0)
    pipeline(workspace, stages, changed).run()
    # "two" makes the same bytes as before, so that "three" has nothing new to do.
    assert runs(stages) == [1, 2, 1]


def test_a_changed_input_reruns_all_after_it(workspace: Workspace, stages: list[Copy]) -> None:
    pipeline(workspace, stages).run()
    (workspace.root / "raw" / "a.txt").write_text("gamma")
    pipeline(workspace, stages).run()
    assert runs(stages) == [2, 2, 2]
    assert (workspace.root / "third" / "a.txt").read_text() == "GAMMA"


def test_a_touched_but_equal_input_reruns_nothing(workspace: Workspace, stages: list[Copy]) -> None:
    pipeline(workspace, stages).run()
    os.utime(workspace.root / "raw" / "a.txt", (1.0, 1.0))
    pipeline(workspace, stages).run()
    assert runs(stages) == [1, 1, 1]


def test_a_new_version_of_a_stage_reruns_it(workspace: Workspace, stages: list[Copy]) -> None:
    pipeline(workspace, stages).run()
    stages[1].version = 2
    pipeline(workspace, stages).run()
    assert runs(stages) == [1, 2, 1]


@pytest.mark.parametrize("damage", ["remove", "change"])
def test_an_output_that_was_lost_or_changed_is_made_again(
    workspace: Workspace, stages: list[Copy], damage: str
) -> None:
    pipeline(workspace, stages).run()
    made = workspace.root / "second" / "a.txt"
    if damage == "remove":
        made.unlink()
    else:
        made.write_text("other")
    pipeline(workspace, stages).run()
    assert runs(stages) == [1, 2, 1]
    assert made.read_text() == "ALPHA"


def test_outputs_of_inputs_that_are_gone_are_removed(
    workspace: Workspace, stages: list[Copy]
) -> None:
    pipeline(workspace, stages).run()
    (workspace.root / "raw" / "b.txt").unlink()
    pipeline(workspace, stages).run()
    for folder in ("first", "second", "third"):
        assert [p.name for p in (workspace.root / folder).iterdir()] == ["a.txt"]


def test_an_obsolete_output_changed_by_hand_is_kept(
    workspace: Workspace, stages: list[Copy]
) -> None:
    pipeline(workspace, stages[:1]).run()
    (workspace.root / "raw" / "b.txt").unlink()
    (workspace.root / "first" / "b.txt").write_text("by hand")
    pipeline(workspace, stages[:1]).run()
    assert (workspace.root / "first" / "b.txt").read_text() == "by hand"


def test_a_failed_stage_keeps_the_earlier_ones_and_is_due_again(
    workspace: Workspace, stages: list[Copy]
) -> None:
    def fail(_: StageContext) -> None:
        raise WorkspaceError("the disk is full", "somewhere")

    stages[1].act = fail
    with pytest.raises(WorkspaceError, match="disk is full"):
        pipeline(workspace, stages).run()
    assert pipeline(workspace, stages).states() == {
        "one": "up to date",
        "two": "due",
        "three": "due",
    }
    stages[1].act = lambda _: None
    pipeline(workspace, stages).run()
    assert runs(stages) == [1, 2, 1]


def test_an_interrupted_run_finds_its_scratch_again(
    workspace: Workspace, stages: list[Copy]
) -> None:
    found: list[bool] = []

    def interrupted(context: StageContext) -> None:
        found.append((context.scratch / "half").exists())
        (context.scratch / "half").write_text("done so far")
        if len(found) == 1:
            raise KeyboardInterrupt

    stages[0].act = interrupted
    with pytest.raises(KeyboardInterrupt):
        pipeline(workspace, stages).run()
    pipeline(workspace, stages).run()
    assert found == [False, True]
    assert not (workspace.root / SCRATCH_FOLDER / "one").exists()


def test_no_scratch_is_left_behind(workspace: Workspace, stages: list[Copy]) -> None:
    """Neither of a run that ends well, nor of a killed one whose settings were taken back."""
    pipeline(workspace, stages).run()
    left = workspace.root / SCRATCH_FOLDER
    assert not left.exists()
    killed = left / "one" / "0123456789abcdef"
    killed.mkdir(parents=True)
    (killed / "half").write_text("done so far")
    records = workspace.root / "provenance"
    (records / ".one.json.k1ll3d.part").write_text("half a record")
    pipeline(workspace, stages).run()
    assert not left.exists()
    assert sorted(path.name for path in records.iterdir()) == ["one.json", "three.json", "two.json"]


def test_scratch_of_other_settings_is_not_found(workspace: Workspace, stages: list[Copy]) -> None:
    found: list[bool] = []

    def interrupted(context: StageContext) -> None:
        found.append((context.scratch / "half").exists())
        (context.scratch / "half").write_text("done so far")
        raise KeyboardInterrupt

    stages[0].act = interrupted
    for gsd in (1.0, 2.0):
        settings = Settings().with_table("mapolas", gsd_m=gsd)
        with pytest.raises(KeyboardInterrupt):
            pipeline(workspace, stages, settings).run()
    assert found == [False, False]
    assert len(list((workspace.root / SCRATCH_FOLDER / "one").iterdir())) == 1


def test_a_stage_without_inputs_is_passed_over_with_a_reason(
    workspace: Workspace, stages: list[Copy]
) -> None:
    stages.insert(1, Copy("extra", "nowhere", "nothing"))
    states = {run.stage: (run.state, run.reason) for run in pipeline(workspace, stages).run()}
    assert states["extra"] == ("cannot run", "nothing in nowhere")
    assert states["three"] == ("ran", "")


def test_where_nothing_can_run_that_is_an_error(workspace: Workspace) -> None:
    with pytest.raises(WorkspaceError, match="nothing can run: nothing in nowhere"):
        pipeline(workspace, [Copy("extra", "nowhere", "nothing")]).run()


def test_one_stage_runs_alone(workspace: Workspace, stages: list[Copy]) -> None:
    assert pipeline(workspace, stages).run_stage("one").state == "ran"
    assert runs(stages) == [1, 0, 0]
    with pytest.raises(WorkspaceError, match="three cannot run: nothing in second"):
        pipeline(workspace, stages).run_stage("three")


def test_a_stage_reads_only_the_tables_it_declared(
    workspace: Workspace, stages: list[Copy]
) -> None:
    stages[0].act = lambda context: context.progress.note(str(context.table(FuseSettings)))
    with pytest.raises(SettingsError, match="does not declare FuseSettings"):
        pipeline(workspace, stages).run()


@pytest.mark.parametrize("damage", ["remove", "rubbish", "half", "empty", "other tables"])
def test_a_lost_catalogue_is_built_again_from_the_records(
    workspace: Workspace, stages: list[Copy], damage: str
) -> None:
    pipeline(workspace, stages).run()
    path = workspace.root / CATALOG_FILE
    content = path.read_bytes()
    if damage == "remove":
        path.unlink()
    elif damage == "rubbish":
        path.write_bytes(b"this is no data base, however long it goes on " * 100)
    elif damage == "half":
        path.write_bytes(content[: len(content) // 2])
    elif damage == "empty":
        path.write_bytes(b"")
    else:
        path.unlink()
        with sqlite3.connect(path) as base:
            base.execute("CREATE TABLE other (x)")
        base.close()
    assert set(pipeline(workspace, stages).states().values()) == {"up to date"}
    pipeline(workspace, stages).run()
    assert runs(stages) == [1, 1, 1]


def test_a_damaged_record_costs_a_run_and_nothing_else(
    workspace: Workspace, stages: list[Copy]
) -> None:
    pipeline(workspace, stages).run()
    (workspace.root / CATALOG_FILE).unlink()
    (workspace.root / "provenance" / "two.json").write_text('{"stage": "two"')
    pipeline(workspace, stages).run()
    assert runs(stages) == [1, 2, 1]


def test_the_catalogue_records_what_was_made_from_what(
    workspace: Workspace, stages: list[Copy]
) -> None:
    pipeline(workspace, stages).run()
    record = json.loads((workspace.root / "provenance" / "two.json").read_text())
    assert set(record["inputs"]) == {"first/a.txt", "first/b.txt"}
    assert set(record["outputs"]) == {"second/a.txt", "second/b.txt"}
    assert record["settings"]["RegisterSettings"]["model"] == "similarity"
    assert record["summary"]["nan"] is None
    catalog = Catalog(workspace)
    stored = catalog.record("two")
    catalog.close()
    assert stored is not None
    assert dict(stored.outputs) == record["outputs"]


def test_two_programs_do_not_work_in_one_workspace(
    workspace: Workspace, stages: list[Copy]
) -> None:
    with (workspace.root / LOCK_FILE).open("w") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(WorkspaceError, match="another spcola is at work"):
            pipeline(workspace, stages).run()
        assert set(pipeline(workspace, stages).states()) == {"one", "two", "three"}
    pipeline(workspace, stages).run()


def test_a_workspace_can_be_moved(workspace: Workspace, stages: list[Copy]) -> None:
    pipeline(workspace, stages).run()
    moved = workspace.root.rename(workspace.root.with_name("elsewhere"))
    pipeline(Workspace.open(moved), stages).run()
    assert runs(stages) == [1, 1, 1]


@pytest.mark.parametrize("severity", ["doubtful", "refused"])
def test_what_rests_on_a_result_that_may_not_be_used_does_not_run(
    workspace: Workspace, stages: list[Copy], severity: str
) -> None:
    """Directly or through another stage; a doubtful result is used once its code is accepted."""
    pipeline(workspace, stages).run()
    one, two, three = stages
    one.version = 2
    two.needs, three.needs = ("one",), ("two",)
    one.verdict = Verdict((Finding(Code.CHANGED_INPUT, Severity(severity), "it is odd"),))
    found = pipeline(workspace, stages).run()
    assert [run.state for run in found] == ["ran", "cannot run", "cannot run"]
    assert severity in found[0].obstacle
    assert all("it is odd [changed-input]" in run.reason for run in found[1:]), found
    with pytest.raises(WorkspaceError, match="it is odd"):
        pipeline(workspace, stages).run_stage("three")
    accepting = Settings.model_validate({"accept": {"codes": ["changed-input"]}})
    again = pipeline(workspace, stages, accepting).run()
    expected = ["up to date"] * 2 if severity == "doubtful" else ["cannot run"] * 2
    assert [run.state for run in again] == ["up to date", *expected]
    assert bool(again[0].obstacle) == (severity == "refused")


def chained(workspace: Workspace, stages: list[Copy]) -> Pipeline:
    """Stages with declared places and needs."""
    one, two, three = stages
    one.places, two.places, three.places = ("first",), ("second",), ("third",)
    two.needs, three.needs = ("one",), ("two",)
    return pipeline(workspace, stages)


def change(path: Path) -> None:
    path.write_text("other")


@pytest.mark.parametrize(
    ("name", "act", "words"),
    [
        ("second/a.txt", change, "second/a.txt has changed since stage two wrote it"),
        ("second/a.txt", Path.unlink, "second/a.txt, which stage two wrote, is gone"),
        ("second/new.txt", change, "second/new.txt is not in the record of stage two"),
        # Of what the stage before rests on, too.
        ("first/a.txt", change, "first/a.txt has changed since stage one wrote it"),
    ],
)
def test_results_that_are_not_as_their_stage_left_them_are_refused_by_the_next(
    workspace: Workspace, stages: list[Copy], name: str, act: Callable[[Path], None], words: str
) -> None:
    stacked = chained(workspace, stages)
    stacked.run()
    act(workspace.root / name)
    with pytest.raises(WorkspaceError, match=words) as caught:
        stacked.run_stage("three")
    assert "--accept changed-input" in str(caught.value)
    assert runs(stages) == [1, 1, 1]
    accepting = Settings.model_validate({"accept": {"codes": ["changed-input"]}})
    done = pipeline(workspace, stages, accepting).run_stage("three", force=True)
    assert done.state == "ran"
    record = json.loads((workspace.root / "provenance" / "three.json").read_text())
    assert words in record["summary"]["findings"][0]["text"]
    # A run makes it again with a note; a foreign file is kept, and is still refused.
    if not name.endswith("new.txt"):
        notes = [note for run in stacked.run() for note in run.notes]
        assert any(words in note for note in notes)
        assert (workspace.root / "third" / "a.txt").read_text() == "ALPHA"
    else:
        assert "not made" in stacked.run()[2].obstacle


def test_results_of_which_there_is_no_record_are_used_and_that_is_noted(
    workspace: Workspace, stages: list[Copy]
) -> None:
    stacked = chained(workspace, stages)
    stacked.run()
    (workspace.root / "provenance" / "two.json").unlink()
    (workspace.root / CATALOG_FILE).unlink()
    done = stacked.run_stage("three", force=True)
    assert done.notes == (
        "stage two has no record, so second/a.txt, second/b.txt cannot be checked",
    )


def test_a_lost_record_comes_back_from_the_catalogue(
    workspace: Workspace, stages: list[Copy]
) -> None:
    stacked = chained(workspace, stages)
    stacked.run()
    (workspace.root / "provenance" / "two.json").unlink()
    notes = [note for run in stacked.run() for note in run.notes]
    assert len(notes) == 1
    assert "two.json was gone; restored" in notes[0]
    assert runs(stages) == [1, 1, 1]


def test_lost_results_of_a_stage_that_cannot_make_them_again_are_no_success(
    workspace: Workspace, stages: list[Copy]
) -> None:
    """Else whatever rests on them would be up to date, and old."""
    stacked = chained(workspace, stages)
    stacked.run()
    for folder in ("raw", "first"):
        for path in (workspace.root / folder).iterdir():
            path.unlink()
    change(workspace.root / "raw" / "other.txt")
    stages[0].source = "nowhere"
    first, second, third, _ = pipeline(workspace, [*stages, Copy("x", "raw", "fourth")]).run()
    assert "incomplete: first/a.txt, first/b.txt, which stage one wrote, are gone" in first.obstacle
    assert [second.state, third.state] == ["cannot run", "cannot run"]


def test_an_input_that_changed_since_it_was_used_is_noted(
    workspace: Workspace, stages: list[Copy]
) -> None:
    stacked = chained(workspace, stages)
    stacked.run()
    (workspace.root / "raw" / "a.txt").write_text("gamma")
    notes = [note for run in stacked.run() for note in run.notes]
    assert notes == ["raw/a.txt has changed since stage one last used it"]
