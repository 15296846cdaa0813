"""What ``spcola truth assess`` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from fusion.service.commands.fields import Mark
from fusion.service.commands.site import Done, Site

if TYPE_CHECKING:
    from fusion.runtime import Executor, Progress
    from fusion.truth.assessment import AssessmentSettings, Model, Planted
    from fusion.workspace import Workspace

__all__ = ["AssessOptions", "assess_models"]
_Shown = tuple[dict[str, Any], list[str]]


@dataclass(frozen=True)
class ModelOptions:
    """Which models are assessed."""

    model: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Another model to assess: .MAP, FITS, GeoTIFF, OBJ, PLY, ICQ, or the folder of a "
            "release. Repeat it for several.",
        ),
    ] = None
    frame: Annotated[
        Literal["spc", "body"],
        typer.Option(
            help="Coordinates of the models of --model: those of the SPC solution (spc), or the "
            "true body-fixed ones, which are the lidar's (body)."
        ),
    ] = "spc"
    unit: Annotated[
        Literal["km", "m"], typer.Option(help="Unit of an OBJ or PLY of --model that states none.")
    ] = "km"
    only: Annotated[
        bool, typer.Option("--only", help="Assess the models of --model, not those of WS.")
    ] = False
    solution: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Assess this solution, by default the one in use; all: 3D rms, FormU and effort "
            "of every version, in the order in which they were made.",
        ),
    ] = ""

    def check(self) -> None:
        """Refuse options that contradict each other.

        Raises
        ------
        typer.BadParameter
        """
        if self.only and not self.model:
            raise typer.BadParameter("needs --model", param_hint="--only")
        if self.versions and self.model:
            raise typer.BadParameter("compares no models of --model", param_hint="--solution all")

    @property
    def versions(self) -> bool:
        """Whether all solutions are assessed."""
        return self.solution == "all"


@dataclass(frozen=True)
class SampleOptions:
    """How much of a model is compared."""

    patches: Annotated[
        int,
        typer.Option(
            metavar="N", min=1, max=1_000_000, help="Most maplets whose heights are compared."
        ),
    ] = 200
    vertices: Annotated[
        int,
        typer.Option(
            metavar="N", min=1, max=100_000_000, help="Most vertices of a model in its 3D rms."
        ),
    ] = 40_000


@dataclass(frozen=True)
class AssessOptions:
    """Options of ``spcola truth assess``."""

    truth: Annotated[
        Path,
        typer.Option(metavar="DIR", help="The synthetic mission (the folder of its truth.json)."),
    ]
    chosen: ModelOptions = ModelOptions()
    sample: SampleOptions = SampleOptions()
    report: Annotated[
        Path | None,
        typer.Option(metavar="FILE.html", help="Write a page of figures to this file."),
        Mark.OUTPUT,
    ] = None

    def check(self) -> None:
        """Refuse options that contradict each other; raises typer.BadParameter."""
        self.chosen.check()


def assess_models(site: Site, given: AssessOptions) -> Done:
    """Compare models with the truth of a synthetic mission."""
    from fusion.truth import read_truth
    from fusion.truth.assessment import AssessmentSettings, file_model, workspace_models
    from fusion.workspace import IMPORTED

    given.check()
    chosen, report = given.chosen, given.report
    there = site.open(IMPORTED if chosen.versions else chosen.solution)
    planted = read_truth(given.truth)
    settings = AssessmentSettings(
        patches=given.sample.patches,
        vertices=given.sample.vertices,
        dark_share=planted.settings.solution.darkness.dark,
    )
    work = _Work(planted, there, settings, site.executor, site.progress)
    if chosen.versions:
        content, lines = work.of_versions(report)
    else:
        models = [] if chosen.only else workspace_models(there)
        models += [
            file_model(path, frame=chosen.frame, unit=chosen.unit) for path in chosen.model or []
        ]
        content, lines = work.of_models(models, report)
    if report is not None:
        lines.append(f"report: {report.resolve()}")
    return Done(content, lines)


@dataclass(frozen=True)
class _Work:
    """What both forms of the assessment need."""

    planted: Planted
    workspace: Workspace
    settings: AssessmentSettings
    executor: Executor
    progress: Progress

    def of_models(self, models: Sequence[Model], report: Path | None) -> _Shown:
        """Compare models with the truth; return what is shown, and write the page."""
        from fusion.truth.assessment import assess, assessment_json, assessment_lines, write_page

        found = assess(
            self.planted, models, self.workspace, self.executor, self.progress,
            settings=self.settings,
        )  # fmt: skip
        if report is not None:
            write_page(report, found)
        return assessment_json(found), list(assessment_lines(found))

    def of_versions(self, report: Path | None) -> _Shown:
        """Compare every solution with the truth; return what is shown, and write the page."""
        from fusion.truth.assessment.versions import (
            assess_versions,
            versions_json,
            versions_lines,
            write_versions_page,
        )

        found = assess_versions(
            self.planted, self.workspace, self.executor, self.progress, settings=self.settings
        )
        if report is not None:
            write_versions_page(report, found, self.planted, self.settings)
        return versions_json(found, self.planted, self.settings), list(versions_lines(found))
