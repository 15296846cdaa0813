"""Assessment of models against the truth of a synthetic mission."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fusion.report.planted import RecoveredParameter
from fusion.runtime import Executor, Progress
from fusion.runtime.machine import one_blas_thread
from fusion.truth.assessment.formal import FormalUncertainty, formal_uncertainty
from fusion.truth.assessment.frame import planted_in
from fusion.truth.assessment.model import Model
from fusion.truth.assessment.regions import Ground, Light
from fusion.truth.assessment.score import ModelScore, score_model
from fusion.truth.assessment.settings import AssessmentSettings
from fusion.truth.ground import shadow_ground
from fusion.truth.planted import Planted
from fusion.truth.recovery import compare
from fusion.truth.solution import light_of
from fusion.workspace import Workspace
from spcola.truth.body import TruthBody
from spcola.truth.solid import SolidBody


@dataclass(frozen=True, eq=False)
class Assessment:
    """Results of an assessment.

    Attributes
    ----------
    planted : Planted
    settings : AssessmentSettings
    models : tuple of ModelScore
    formal : FormalUncertainty, optional
        FormU of the SPC solution in the workspace.
    recovered : tuple of RecoveredParameter
        Planted parameters and their estimates in the workspace's registration and scale.
    """

    planted: Planted
    settings: AssessmentSettings
    models: tuple[ModelScore, ...]
    formal: FormalUncertainty | None
    recovered: tuple[RecoveredParameter, ...]


@one_blas_thread()
def assess(
    planted: Planted,
    models: Sequence[Model],
    workspace: Workspace | None,
    executor: Executor,
    progress: Progress,
    *,
    settings: AssessmentSettings | None = None,
) -> Assessment:
    """Compare `models` with the truth, and parameters recovered in `workspace` with planted ones.

    Parameters
    ----------
    planted : Planted
        From :func:`fusion.truth.planted.read_truth`.
    models : sequence of Model
        Those without any height are left out.
    workspace : Workspace, optional
        Registration, scale, landmarks and images are read from it. What is planted is that in the
        frame of its solution (:func:`fusion.truth.assessment.frame.planted_in`).
    executor : Executor
    progress : Progress
    settings : AssessmentSettings, optional
    """
    settings = settings or AssessmentSettings()
    body = planted.body()
    planted = planted if workspace is None else planted_in(planted, workspace)
    with progress.task("light", 1) as task:
        light = light_on(planted, body)
        task.advance()
    ground = Ground(body, light, settings)
    scores = []
    for model in models:
        score = score_model(model, ground, planted.similarity, executor, progress)
        if score is not None:
            scores.append(score)
        else:
            progress.note(f"note: {model.name} has no heights and is left out")
    return Assessment(
        planted,
        settings,
        tuple(scores),
        None if workspace is None else formal_of(workspace),
        () if workspace is None else tuple(_recovered(planted, workspace)),
    )


def light_on(planted: Planted, body: TruthBody) -> Light:
    """Return the share of a rotation for which the ground is lit, as in making the solution."""
    if isinstance(body, SolidBody):
        return light_of(planted.settings, body.surface).at
    return light_of(planted.settings, shadow_ground(planted.settings.body)).at


def formal_of(workspace: Workspace) -> FormalUncertainty | None:
    """Return FormU of the solution in a workspace; None if it has no landmarks or no images."""
    names, images = workspace.maplet_names(), workspace.image_names()
    if not names or not images:
        return None
    grids = {name: workspace.maplet(name).grid for name in names}
    return formal_uncertainty(grids, (workspace.image(name) for name in images))


def _recovered(planted: Planted, workspace: Workspace) -> list[RecoveredParameter]:
    """Compare the registration and scale with the planted values, as far as they exist."""
    paths = (workspace.registration_path, workspace.scale_path)
    found = [workspace.find_json(path.name) or {} for path in paths]
    rows = compare(planted, *found) if any(found) else []
    return [row for row in rows if found[0] or not row.name.startswith("registration")]
