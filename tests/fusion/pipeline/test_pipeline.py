"""The pipeline: skipping, re-running, resuming."""

from __future__ import annotations

import fcntl
import os

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from fusion.estimation.verdict import Code, Finding, Severity, Verdict
from fusion.pipeline import StageContext
from fusion.pipeline.pipeline import SCRATCH_FOLDER
from fusion.runtime.folders import LOCK_FILE
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.processing import FuseSettings
from spcola.errors import SettingsError, WorkspaceError

from .conftest import Copy, pipeline, runs


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
    inner = workspace.root / "bigmaps" / "returns"
    inner.mkdir()
    (inner / ".NPOLE.MAP.k1ll3d.part").write_text("half a map")
    pipeline(workspace, stages).run()
    assert not left.exists()
    assert not any(inner.iterdir())
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
