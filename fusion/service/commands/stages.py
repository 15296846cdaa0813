"""What the commands of the stages do: a pipeline with settings of this run, and its end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusion.service.commands.site import Site
from spcola.errors import InvalidValueError, RejectedResultError

if TYPE_CHECKING:
    from fusion.pipeline import Pipeline, StageRun
    from fusion.stages.scale import AppliedScale
    from fusion.workspace.settings import Settings

__all__ = [
    "UnusableResultError",
    "accepting",
    "apply_scale_of",
    "check_stages",
    "check_usable",
    "pipeline_of",
]


def pipeline_of(
    site: Site, settings: Settings, *, only: Sequence[str] = (), within: str = ""
) -> Pipeline:
    """Return all stages over a workspace, or over a part of its items."""
    from fusion.pipeline import Pipeline, Subset
    from fusion.stages import load_stages

    subset = Subset.of(only, within)
    stages = load_stages()
    return Pipeline(site.open(), settings, stages, site.executor, site.progress, site.wait, subset)


def accepting(settings: Settings, codes: Sequence[str]) -> Settings:
    """Return settings that accept findings with further codes; raises SettingsError."""
    if not codes:
        return settings
    return settings.with_table("accept", codes=[*settings.accept.codes, *codes])


def check_stages(names: Sequence[str], only: Sequence[str] = (), within: str = "") -> None:
    """Refuse names of no stage, and a subset that cannot be.

    Raises
    ------
    InvalidValueError
        It names the stages that there are.
    """
    from fusion.pipeline import Subset
    from fusion.stages import load_stages

    known = [stage.name for stage in load_stages()]
    for name in names:
        if name not in known:
            raise InvalidValueError(
                f"there is no stage {name!r}", "stages", f"use {', '.join(known)}"
            )
    if only and len(names) != 1:
        raise InvalidValueError("names items of one stage: name it in stages", "only")
    Subset.of(only, within)


class UnusableResultError(RejectedResultError):
    """A stage has a result that may not be used; `result` is what the command prints of it."""

    def __init__(self, what: str, where: Path, result: Mapping[str, Any]) -> None:
        self.result = result
        super().__init__(what, where)


def check_usable(
    pipeline: Pipeline, runs: Sequence[StageRun], result: Mapping[str, Any] | None = None
) -> None:
    """End with an error if a result may not be used, so that later stages did not run.

    Parameters
    ----------
    pipeline : Pipeline
    runs : sequence of StageRun
    result : mapping, optional
        What ``--json`` has of them.

    Raises
    ------
    UnusableResultError
    """
    for run in runs:
        if run.obstacle:
            what = f"the result of {run.stage} is {run.obstacle}"
            raise UnusableResultError(what, pipeline.workspace.root, result or {})


def apply_scale_of(
    pipeline: Pipeline, name: str, *, force: bool = False, job: str = ""
) -> tuple[StageRun, AppliedScale]:
    """Bring the scale up to date, and make the scaled solution: the same `job` makes one only."""
    from fusion.stages.scale import apply_scale
    from fusion.workspace.solution_records import check_name

    if name:
        check_name(name)
    ran = pipeline.run_stage("scale", force=force)
    check_usable(pipeline, [ran])
    codes = pipeline.settings.accept.codes
    applied = apply_scale(pipeline.workspace, name, pipeline.progress, accepted=codes, job=job)
    return ran, applied
