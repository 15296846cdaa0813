"""Scale: lidar ranges against the SPC solution, by paired bigmaps or by single shots."""

from __future__ import annotations

from pathlib import Path

from fusion.estimation.verdict import Verdict
from fusion.pipeline import Stage, StageContext, StageResult
from fusion.scaling.judging import consistency, consistency_findings
from fusion.scene.geolocation import return_paths
from fusion.stages.ingest import readable_scans
from fusion.stages.ingest.lidar_files import check_duplicates
from fusion.stages.line_scans import line_scans_not_used, no_images
from fusion.stages.scale.pairs import scale_by_pairs
from fusion.stages.scale.shots import scale_by_shots
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.inputs import BodySettings, SpiceSettings, SpinSettings
from fusion.workspace.settings.processing import ScaleSettings
from spcola.shape import RayCaster


class ScaleStage(Stage):
    """Scans, images and SPC surface → scale.json and pairs/."""

    name = "scale"
    version = 12
    needs = ("ingest", "register")
    places = ("scale.json", "pairs")
    tables = (ScaleSettings, BodySettings, SpinSettings, SpiceSettings)

    def compares_lidar(self, settings: Settings) -> bool:
        """Return whether lidar ranges are compared with maplets."""
        return settings.scale.method == "pairs"

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why no scale can be estimated; empty if it can."""
        if not workspace.scan_names():
            return f"there are no scans; run: spcola import {workspace.root} FILE"
        if not workspace.has_shape():
            return "there is no shape in SHAPEFILES to cast rays on"
        if settings.scale.method == "pairs":
            if lacking := no_images(workspace):
                return f"{lacking} to pair; use --method shots"
            if not workspace.maplet_names():
                return "there are no maplets in MAPFILES to pair; use --method shots"
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return scans, shape, images, the registration if there is one, and maplets for pairs."""
        paths = [*return_paths(workspace, settings), workspace.shape_path()]
        if workspace.registration_path.is_file():
            paths += [workspace.registration_path, *workspace.mapola_paths()]
        paths += workspace.state_files()
        if settings.scale.method == "pairs":
            paths += workspace.maplet_files()
        return paths

    def run(self, context: StageContext) -> StageResult:
        """Compare, estimate jointly, write; also if nothing can be compared."""
        workspace, table = context.workspace, context.table(ScaleSettings)
        check_duplicates(workspace, readable_scans(workspace))
        shape = workspace.shape()
        radius = context.table(BodySettings).mean_radius_m or shape.mean_radius
        caster = RayCaster(shape)
        method = scale_by_shots if table.method == "shots" else scale_by_pairs
        found = method(context, caster, radius)
        content, findings = found.content, found.findings
        if workspace.registration_path.is_file():
            registration = workspace.read_json(workspace.registration_path.name)
            compared = consistency(content, registration, found.registration_covariance)
            content["registration_consistency"] = compared
            findings = [*findings, *consistency_findings(compared)]
        content |= Verdict(tuple(findings)).as_json()
        path = context.write_json(workspace.scale_path.name, content)
        summary = {k: v for k, v in content.items() if k not in _LONG}
        summary |= line_scans_not_used(workspace)
        return StageResult((path, *found.files), summary)


STAGE = ScaleStage()

_LONG = frozenset({"per_pair", "per_shot", "covariance", "parameters"})
