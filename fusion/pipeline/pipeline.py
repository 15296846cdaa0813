"""The pipeline runs the stages whose inputs, settings or version changed, and only those."""

from __future__ import annotations

import shutil
import time
from collections.abc import Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fusion.estimation.verdict import Code, Finding, Severity, Verdict
from fusion.pipeline.catalog.catalog import Catalog
from fusion.pipeline.catalog.records import SHARED_STAGES, StageRecord
from fusion.pipeline.catalog.soundness import Unsound, rejected_maplets, unsound
from fusion.pipeline.changed_files import Changed, changed_since
from fusion.pipeline.changes import Changes
from fusion.pipeline.items import ItemStore, item_folder
from fusion.pipeline.opened import opened
from fusion.pipeline.solutions.lidar_content import LidarContent
from fusion.pipeline.stage import Stage, StageContext
from fusion.pipeline.stage_key import StageKey, current_record, keep_result, repeats, stage_key
from fusion.pipeline.stage_run import StageRun
from fusion.pipeline.standing import Standing, differing
from fusion.pipeline.subset import Subset
from fusion.runtime import Executor, Progress, ThreadExecutor, json_value
from fusion.runtime.folders import make_folder, remove_folder
from fusion.runtime.machine import one_blas_thread
from fusion.runtime.processes import check_interrupts
from fusion.workspace import IMPORTED, Workspace
from fusion.workspace.settings import Settings
from spcola.errors import SpcolaError, WorkspaceError
from spcola.formats.shapes import recognise_shape

SCRATCH_FOLDER = ".scratch"


@dataclass(frozen=True)
class Pipeline:
    """Stages over one workspace.

    Parameters
    ----------
    workspace : Workspace
    settings : Settings
    stages : sequence of Stage
        In the order in which data pass through them.
    executor, progress
        Where work is done, and where its progress is reported.
    wait : bool
        Whether to wait while another program works with the same solution.
    subset : Subset
        Which items of the stages are made. A stage of which some were left out remains due.
    """

    workspace: Workspace
    settings: Settings
    stages: Sequence[Stage]
    executor: Executor = field(default_factory=ThreadExecutor)
    progress: Progress = field(default_factory=Progress)
    wait: bool = False
    subset: Subset = field(default_factory=Subset)

    @one_blas_thread()
    def run(self, *, force: bool = False) -> list[StageRun]:
        """Bring every stage up to date; one without its inputs is skipped with a reason.

        Raises
        ------
        WorkspaceError
            If no stage can run.
        SpcolaError
            If a stage fails; results of earlier stages are kept.
        """
        with opened(self.workspace, wait=self.wait) as catalog:
            fit = self._without_unsound(catalog)
            runs = [fit._brought(stage, catalog, force) for stage in self.stages]
        if all(run.state == "cannot run" for run in runs):
            reason = runs[0].reason if runs else "there is no stage"
            raise WorkspaceError(f"nothing can run: {reason}", self.workspace.root)
        return runs

    @one_blas_thread()
    def run_stage(self, name: str, *, force: bool = False) -> StageRun:
        """Bring one stage up to date; the others are left as they are.

        Raises
        ------
        WorkspaceError
            If it lacks its inputs.
        SpcolaError
            If it fails.
        """
        stage = next((stage for stage in self.stages if stage.name == name), None)
        if stage is None:
            names = ", ".join(stage.name for stage in self.stages)
            raise WorkspaceError(f"there is no stage {name!r}", self.workspace.root, f"use {names}")
        with opened(self.workspace, wait=self.wait) as catalog:
            for earlier in self.stages[: self.stages.index(stage)]:
                if self._is_stale(earlier, catalog):
                    self.progress.note(
                        f"note: {earlier.name} is out of date; spcola run brings all up to date"
                    )
            run = self._without_unsound(catalog)._brought(stage, catalog, force)
        if run.state == "cannot run":
            raise WorkspaceError(f"{name} cannot run: {run.reason}", self.workspace.root)
        return run

    def states(self, catalog: Catalog | None = None) -> dict[str, str]:
        """Return for each stage "up to date", "due", or "cannot run: …".

        `catalog` is one that is open for reading, by default a new one.
        """
        if catalog is not None:
            return {name: one.state for name, one in self.standings(catalog).items()}
        # Without the lock: a workspace can be read while another program works in it.
        with closing(Catalog(self.workspace, read_only=True)) as opened_now:
            return self.states(opened_now)

    def standings(self, catalog: Catalog) -> dict[str, Standing]:
        """Return how each stage stands to the files that it reads and wrote."""
        return {stage.name: self._standing(stage, catalog) for stage in self.stages}

    def _of_all(self) -> Pipeline:
        """Return the pipeline of what all solutions of the workspace share."""
        shared = [stage for stage in self.stages if stage.name in SHARED_STAGES]
        return replace(self, workspace=replace(self.workspace, solution=IMPORTED), stages=shared)

    def _is_of_all(self, stage: Stage) -> bool:
        """Return whether the result of `stage` is shared with other solutions, and not its own."""
        return self.workspace.solution != IMPORTED and stage.name in SHARED_STAGES

    def _brought(self, stage: Stage, catalog: Catalog, force: bool) -> StageRun:
        """Bring a stage up to date: in this solution, or for all of them if they share its result.

        Only if there is something to do for all must no other program work in the workspace.
        """
        if found := self._lidar_twice(stage):
            return StageRun(stage.name, "cannot run", reason=found)
        if not self._is_of_all(stage):
            return self._update(stage, catalog, force)
        shared, record = self._of_all(), catalog.record(stage.name)
        if not force and record and shared.states()[stage.name] == "up to date":
            run = StageRun(stage.name, "up to date", summary=record.summary)
            return run.judged(self.settings.accept.codes, ())
        with opened(shared.workspace, wait=self.wait) as of_all:
            return shared._update(stage, of_all, force)

    def _standing(self, stage: Stage, catalog: Catalog) -> Standing:
        """Return how `stage` stands to its files; see :meth:`standings`."""
        if self._is_of_all(stage):
            shared = self._of_all()
            with closing(Catalog(shared.workspace, read_only=True)) as of_all:
                return shared._standing(stage, of_all)
        try:
            missing = self._lidar_twice(stage)
            missing = missing or stage.missing(self.workspace, self.settings)
            missing = missing or self._obstacle(stage, catalog)
            if missing:
                return Standing(stage.name, barred=missing)
            key, record = self._key(stage, catalog), catalog.record(stage.name)
            if record is None:
                return Standing(stage.name)
            again = repeats(record, key)
            changed = Changes(self.stages, catalog).own(stage)
        except SpcolaError as error:
            return Standing(stage.name, barred=str(error))
        recorded = {name: record.outputs[name] for name in changed.differing}
        inputs = differing(record.inputs, key.inputs) if again else {}
        return Standing(stage.name, "", again, inputs, recorded, changed.gone)

    def _update(self, stage: Stage, catalog: Catalog, force: bool) -> StageRun:
        """Run `stage` unless it is up to date or lacks its inputs."""
        check_interrupts()
        changes = Changes(self.stages, catalog)
        missing = stage.missing(self.workspace, self.settings)
        if missing:
            return self._without_inputs(stage, missing, changes)
        if found := self._obstacle(stage, catalog):
            return StageRun(stage.name, "cannot run", reason=found)
        begun, started = time.monotonic(), time.time()
        key = self._key(stage, catalog)
        before = changes.before(stage, key.inputs)
        against = [changed for changed in before if changed.is_contradicted]
        if against and Code.CHANGED_INPUT not in self.settings.accept.codes:
            return StageRun.not_made(stage.name, self._advice(against[0]))
        if not force and (record := current_record(catalog, stage.name, key)):
            # Parts that a killed run with other settings had finished are of no use.
            remove_folder(self._scratch / stage.name)
            run = StageRun(stage.name, "up to date", summary=record.summary)
            return run.judged(self.settings.accept.codes, self._report(catalog, ()))
        bad = self._unsound(key.inputs, catalog)
        if bad and Code.UNSOUND_MAPLET not in self.settings.accept.codes:
            return StageRun.not_made(stage.name, _sound_advice(bad))
        own = changes.own(stage)
        noted = _notes(stage, own, changes.used_before(stage, key.inputs))
        notes = self._report(catalog, [*(changed.text for changed in before), *noted])
        context = self._context(stage, key, own, catalog.record(stage.name))
        self._note_shape(key.inputs)
        self.progress.begin_stage(stage.name)
        result = stage.run(context)
        if self.subset:
            result = replace(result, summary={**result.summary, "subset": self.subset.as_json()})
        findings = [changed.finding(Severity.NOTE) for changed in against]
        findings += [one.left_out() for one in bad]
        findings += [] if (twice := self._lidar_content(stage)) is None else [twice.finding]
        if unsound_matters(key.inputs) and self.workspace.registration_path.name in key.inputs:
            findings += rejected_maplets(self.workspace)
        result = replace(result, summary=_with_findings(result.summary, findings))
        keep_result(catalog, stage.name, key, result, partly=bool(self.subset))
        remove_folder(context.scratch.parent)
        if not self.subset:
            context.items.remove_unused(since=started)
        took = time.monotonic() - begun
        summary = json_value(result.summary)
        run = StageRun(stage.name, "ran", took, summary, remarks=result.remarks)
        return run.judged(
            self.settings.accept.codes, (*notes, *self._report(catalog, result.notes))
        )

    def _context(
        self, stage: Stage, key: StageKey, own: Changed, last: StageRecord | None
    ) -> StageContext:
        """Return what `stage` runs with; finished parts of runs with other keys are removed."""
        scratch = self._scratch / stage.name / key.digest[:16]
        if scratch.parent.is_dir():
            for left in scratch.parent.iterdir():
                if left != scratch:
                    shutil.rmtree(left, ignore_errors=True)
        make_folder(scratch)
        items = ItemStore(item_folder(self.workspace.home, stage.name), key.version)
        return StageContext(
            self.workspace, self.settings, stage.tables, self.executor, self.progress,
            key.inputs, key.digest, scratch, items, own, self.subset, last,
        )  # fmt: skip

    @property
    def _scratch(self) -> Path:
        return self.workspace.home / SCRATCH_FOLDER

    def _note_shape(self, inputs: Mapping[str, str]) -> None:
        """Print the remark on an ICQ shape whose edges do not close, if the stage reads it."""
        if not self.workspace.has_shape():
            return
        path = self.workspace.shape_path()
        if self.workspace.relative(path) not in inputs or recognise_shape(path) != "icq":
            return
        if remark := self.workspace.shape().remark:
            self.progress.note(f"note: {path}: {remark} ([body] icq_edges)")

    def _without_unsound(self, catalog: Catalog) -> Pipeline:
        """Return the pipeline without unsound maplets in its workspace, if that is accepted."""
        if Code.UNSOUND_MAPLET not in self.settings.accept.codes:
            return self
        names = frozenset(one.name for one in unsound(self.workspace, catalog))
        return replace(self, workspace=replace(self.workspace, left_out=names))

    def _unsound(self, inputs: Mapping[str, str], catalog: Catalog) -> tuple[Unsound, ...]:
        """Return the unsound maplets if the stage reads maplets, including those left out."""
        if not unsound_matters(inputs):
            return ()
        return unsound(replace(self.workspace, left_out=frozenset()), catalog)

    def _lidar_content(self, stage: Stage) -> LidarContent | None:
        """Return how the lidar came into the maplets with which a stage compares or fuses it."""
        compared = stage.compares_lidar(self.settings)
        return LidarContent.of(self.workspace) if compared else None

    def _lidar_twice(self, stage: Stage) -> str:
        """Return why the lidar may not count again with the maplets of `stage`; empty if it may."""
        content = self._lidar_content(stage)
        accepted = self.settings.accept.codes
        return "" if content is None else content.obstacle(self.workspace, accepted)

    def _without_inputs(self, stage: Stage, missing: str, changes: Changes) -> StageRun:
        """Return the outcome of a stage without its inputs.

        If its earlier results are gone, stages that depend on them must not pass as up to date.
        """
        gone = changes.own(stage).gone
        if not gone or Code.CHANGED_INPUT in self.settings.accept.codes:
            return StageRun(stage.name, "cannot run", reason=missing)
        advice = self._advice(Changed(stage.name, gone=gone))
        return StageRun(stage.name, "cannot run", reason=advice, obstacle=f"incomplete: {advice}")

    def _advice(self, changed: Changed) -> str:
        """Return what has changed, and what to do about it."""
        if changed.stage != self.stages[0].name:
            again = f"run: spcola {changed.stage} {self.workspace.root} again"
        elif changed.gone:
            again = "bring them back or import their files again"
        else:
            again = f"run: spcola run {self.workspace.root}"
        return f"{changed.text}; {again}, or --accept {Code.CHANGED_INPUT}"

    def _report(self, catalog: Catalog, notes: Sequence[str]) -> tuple[str, ...]:
        """Print notes, and those of the catalogue; return them."""
        reported = (*catalog.notes, *notes)
        catalog.notes.clear()
        for note in reported:
            self.progress.note(f"note: {note}")
        return reported

    def _obstacle(self, stage: Stage, catalog: Catalog) -> str:
        """Return which result that `stage` needs may not be used, and why; empty if all may."""
        for needed in (one for one in self.stages if one.name in stage.needs):
            record = catalog.record(needed.name)
            verdict = Verdict() if record is None else Verdict.from_json(record.summary)
            found = verdict.obstacle(self.settings.accept.codes)
            if found:
                return f"the result of {needed.name} is {found}"
            # A result of an earlier program may lack the finding.
            if record is not None and (twice := self._lidar_twice(needed)):
                return f"there is a result of {needed.name}, but {twice}"
            if further := self._obstacle(needed, catalog):
                return further
        return ""

    def _key(self, stage: Stage, catalog: Catalog) -> StageKey:
        return stage_key(stage, self.workspace, self.settings, catalog)

    def _is_stale(self, stage: Stage, catalog: Catalog) -> bool:
        """Return whether `stage` ran before but its inputs, settings or version changed since."""
        if self._is_of_all(stage):
            return self._standing(stage, catalog).state.startswith("due")
        if catalog.record(stage.name) is None or stage.missing(self.workspace, self.settings):
            return False
        return current_record(catalog, stage.name, self._key(stage, catalog)) is None


def unsound_matters(inputs: Collection[str]) -> bool:
    """Return whether a stage with these inputs reads maplets."""
    return any(name.startswith("MAPFILES/") for name in inputs)


def _sound_advice(unsound: Sequence[Unsound]) -> str:
    """Return what is wrong with maplets, and what to do about it."""
    first, more = unsound[0], len(unsound) - 1
    others = f" (and {more} more)" if more else ""
    return (
        f"{first.text}{others}; restore the file, or leave it out with "
        f"--accept {Code.UNSOUND_MAPLET}"
    )


def _notes(stage: Stage, own: Changed, used: Sequence[str]) -> list[str]:
    """Return notes to print before `stage` runs: its results or inputs changed."""
    notes = [changed_since(used, stage.name)] if used else []
    return [*notes, f"{own.text}: the stage runs again"] if own else notes


def _with_findings(summary: Mapping[str, Any], findings: Sequence[Finding]) -> Mapping[str, Any]:
    """Add findings to a summary."""
    if not findings:
        return summary
    verdict = Verdict.from_json(json_value(summary))
    return {**summary, **Verdict((*verdict.findings, *findings)).as_json()}
