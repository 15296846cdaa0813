"""Every solution of a workspace against the truth, in the order in which they were made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from fusion.pipeline.solutions import solutions_of
from fusion.runtime import Executor, Progress
from fusion.runtime.machine import one_blas_thread
from fusion.truth.assessment.assessment import formal_of, light_on
from fusion.truth.assessment.formal import FormalUncertainty
from fusion.truth.assessment.frame import planted_in
from fusion.truth.assessment.gather import solution_models
from fusion.truth.assessment.regions import Ground
from fusion.truth.assessment.score import ModelScore, score_model
from fusion.truth.assessment.settings import AssessmentSettings
from fusion.truth.assessment.versions.effort import Effort, effort_of
from fusion.truth.planted import Planted
from fusion.workspace import Workspace
from fusion.workspace.solution_records import SolutionRecord


@dataclass(frozen=True, eq=False)
class VersionScore:
    """One solution against the truth.

    Attributes
    ----------
    record : SolutionRecord
    models : tuple of ModelScore
        Its maplets and its shape, as far as they exist.
    formal : FormalUncertainty, optional
    effort : Effort
    """

    record: SolutionRecord
    models: tuple[ModelScore, ...]
    formal: FormalUncertainty | None
    effort: Effort


@one_blas_thread()
def assess_versions(
    planted: Planted,
    workspace: Workspace,
    executor: Executor,
    progress: Progress,
    *,
    settings: AssessmentSettings | None = None,
) -> list[VersionScore]:
    """Compare every solution of a workspace with the truth, the imported one first.

    Weirich et al. (section 3) keep intermediate models for such a curve of accuracy over effort.

    Parameters
    ----------
    planted : Planted
    workspace : Workspace
    executor : Executor
    progress : Progress
    settings : AssessmentSettings, optional

    Raises
    ------
    SpcolaError
        If a solution is damaged.
    """
    settings = settings or AssessmentSettings()
    records = in_order(solutions_of(workspace).sound())
    body = planted.body()
    with progress.task("light", 1) as task:
        ground = Ground(body, light_on(planted, body), settings)
        task.advance()
    there = {one.name: replace(workspace, solution=one.name) for one in records}
    found = []
    for record in records:
        version = there[record.name]
        similarity = planted_in(planted, version).similarity
        scores = [
            score_model(
                replace(model, name=f"{model.name} of {record.name}"),
                ground, similarity, executor, progress,
            )
            for model in solution_models(version)
        ]  # fmt: skip
        found.append(
            VersionScore(
                record,
                tuple(score for score in scores if score is not None),
                formal_of(version),
                effort_of(record, version, there.get(record.parent)),
            )
        )
    return found


def in_order(records: Sequence[SolutionRecord]) -> list[SolutionRecord]:
    """Return records in the order in which the solutions were made.

    Those made in the same second keep their order, in which each follows its parent.
    """
    return sorted(records, key=lambda one: one.made)
