"""Report: all results on one page."""

from __future__ import annotations

from pathlib import Path

from fusion.fusing.maplets import FUSED_HDF5
from fusion.pipeline import Stage, StageContext, StageResult
from fusion.report import gather_report, make_report
from fusion.report.photoclinometry import solved_inputs
from fusion.report.planted import PLANTED_FILE
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.inputs import BodySettings
from fusion.workspace.settings.processing import AcceptSettings
from spcola import atomic


class ReportStage(Stage):
    """Results of all stages → report.html."""

    name = "report"
    version = 6
    places = ("report.html",)
    tables = (BodySettings, AcceptSettings)

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why there is nothing to report; empty if there is."""
        if self.inputs(workspace, settings):
            return ""
        return f"there is nothing to show yet; run: spcola run {workspace.root}"

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return the existing files that the report reads."""
        root = workspace.home
        results = [root / "fused" / FUSED_HDF5, workspace.registration_path, workspace.scale_path]
        candidates = [*results, root / PLANTED_FILE, *workspace.maplet_files()]
        candidates += [*workspace.mapola_paths(), *solved_inputs(workspace)]
        return [path for path in candidates if path.is_file()]

    def run(self, context: StageContext) -> StageResult:
        """Gather the content, compose the page, write it whole or not at all."""
        workspace = context.workspace
        data = gather_report(
            workspace,
            body=context.table(BodySettings).name,
            accepted=context.table(AcceptSettings).codes,
        )
        with context.progress.task("report", 1) as task:
            page = make_report(data)
            task.advance()
        atomic.write_text(workspace.report_path, page)
        summary = {
            "report": workspace.relative(workspace.report_path),
            "surfaces": len(data.surfaces),
            "megabytes": len(page.encode("utf-8")) / 1e6,
        }
        return StageResult((workspace.report_path,), summary)


STAGE = ReportStage()
