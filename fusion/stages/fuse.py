"""Fuse: fused maplets from SPC maplets and registered mapolas."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fusion.estimation.verdict import Code, Finding, Severity, Verdict
from fusion.fusing import FuseOptions, FuseResult, fuse_maplet
from fusion.fusing.maplets import FusedMaplet, Source, write_fused
from fusion.fusing.uncertainty import SlopeInformation
from fusion.pipeline import Stage, StageContext, StageResult, find_table, with_kept
from fusion.runtime.folders import make_folder
from fusion.scene import Scene
from fusion.stages.line_scans import line_scans_not_used
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.inputs import BodySettings
from fusion.workspace.settings.processing import FuseSettings

__all__ = ["STAGE", "fuse_options"]


class FuseStage(Stage):
    """Maplets, mapolas, registration → fused maplets."""

    name = "fuse"
    version = 10
    needs = ("mapolas", "register")
    places = ("fused",)
    tables = (FuseSettings, BodySettings)

    def compares_lidar(self, settings: Settings) -> bool:
        """Return True: heights of maplets and of the lidar count once each."""
        return True

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why nothing can be fused; empty if it can."""
        if not workspace.registration_path.is_file():
            return f"there is no registration; run: spcola register {workspace.root}"
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return registration, mapolas, maplets, images, and the shape if there is one."""
        lit = find_table(settings, FuseSettings).light != "none"
        return [
            workspace.registration_path,
            *workspace.mapola_paths(),
            *workspace.maplet_files(),
            *(workspace.image_files() if lit else []),
            *([workspace.shape_path()] if workspace.has_shape() else []),
        ]

    def run(self, context: StageContext) -> StageResult:
        """Estimate the information of SPC slopes and heights, then fuse every maplet."""
        workspace, table = context.workspace, context.table(FuseSettings)
        scene = Scene.of(workspace, light=table.light)
        information = scene.information(partial(context.map, "compare lidar and SPC"))
        options = fuse_options(table)
        tally, items = _Tally(), context.items

        def fused(name: str) -> FuseResult:
            parts = scene.parts(name)
            return items.result(fuse_maplet, parts, information, options=options)

        grids = {name: scene.grid_of(name) for name in scene.targets}
        chosen = context.chosen(grids, {name: grid.center for name, grid in grids.items()})
        sizes = [float(grid.size**2) for grid in chosen.values()]
        remarks = _estimated_again(context, tally.summary(information), len(chosen))
        remarks += _assumed(information)
        for remark in remarks:
            context.progress.note(f"note: {remark.text} [{remark.code}]")
        done = tally.passed(context.stream("fuse maplets", fused, chosen, sizes=sizes))
        folder = workspace.home / "fused"
        make_folder(folder)
        write_fused(folder, with_kept(grids, chosen, done, _kept_in(workspace)))
        summary = {**tally.summary(information), **tally.verdict().as_json()}
        if table.light != "none":
            summary |= line_scans_not_used(workspace)
        return StageResult(tuple(workspace.fused_paths()), summary, remarks=remarks)


STAGE = FuseStage()


def fuse_options(table: FuseSettings) -> FuseOptions:
    """Return the options of the fusion from the settings."""
    return FuseOptions(
        loss=table.loss,
        fraction=table.constraint_fraction,
        seed=table.seed,
        fill_sigma_m=table.fill_sigma_m,
    )


def _estimated_again(
    context: StageContext, now: Mapping[str, Any], count: int
) -> tuple[Finding, ...]:
    """Return why kept maplets are fused again, if the estimated errors of SPC are others.

    They come from a sample of maplets, compared with the lidar by the registration. If one of
    these changes, all maplets have other errors: a kept one would not be that of a fresh run.
    """
    if context.last is None:
        return ()
    before = context.last.summary
    changed = [
        f"{title} {before[key]:.4g} → {now[key]:.4g}{unit}"
        for key, (title, unit) in _ERRORS.items()
        if before.get(key) is not None and before[key] != now[key]
    ]
    if not changed:
        return ()
    registration = context.workspace.registration_path.name
    other = context.last.inputs.get(registration) != context.inputs.get(registration)
    text = (
        f"{'after another registration ' if other else ''}the errors of SPC were estimated again "
        f"({', '.join(changed)}), so "
        f"{'the maplet is' if count == 1 else f'all {count} maplets are'} fused again"
    )
    return (Finding(Code.SPC_ERRORS_CHANGED, Severity.NOTE, text),)


def _assumed(information: SlopeInformation) -> tuple[Finding, ...]:
    """Return that the errors of SPC are assumed, if they are."""
    if not information.assumed:
        return ()
    text = (
        "too few mapolas have heights of points of the maplets to determine the errors of SPC: a "
        f"step is assumed to err by {information.step_sigma_m:g} m, heights by "
        f"{information.height_sigma_m:g} m, and sigmas of fused heights may be wrong; mapolas as "
        "fine as the maplets determine them"
    )
    return (Finding(Code.SPC_ERRORS_ASSUMED, Severity.NOTE, text),)


def _kept_in(workspace: Workspace) -> Callable[[str], FusedMaplet | None]:
    """Return a function that reads a fused maplet of an earlier run; None if there is none."""
    there = set(workspace.fused_names())
    return lambda name: workspace.fused(name) if name in there else None


# Estimated errors of SPC in the summary, and their units.
_ERRORS = {
    "spc_height_sigma_m": ("heights", " m"),
    "spc_step_sigma_m": ("steps", " m"),
    "spc_steep_sigma": ("per slope", ""),
    "spc_bend_sigma": ("per bending", ""),
    "spc_correlated_cells": ("correlated over", " cells"),
}
# Limit of the differences of lidar and SPC in one maplet relative to those of the solution; for
# correct input they lie within 0.8 and 1.4.
_CONTRADICTS = 3.0
# Maplets named in a finding.
_NAMED = 5


class _Tally:
    """Counts sources, sigmas and misfits of the fused maplets."""

    def __init__(self) -> None:
        self.sources = dict.fromkeys(Source, 0)
        self.sigma: list[float] = []
        self.untied: list[str] = []
        self.misfits: dict[str, float] = {}
        self.downweighted = self.contradicted = self.not_converged = 0

    def passed(self, results: Iterable[FuseResult]) -> Iterator[FusedMaplet]:
        """Yield the maplets and count them."""
        for result in results:
            maplet = result.maplet
            for source in Source:
                self.sources[source] += int(np.count_nonzero(maplet.source == source))
            if maplet.valid.any():
                self.sigma.append(float(np.nanmedian(maplet.sigma)))
            self.untied += [maplet.name] * result.parts_without_lidar
            self.misfits[maplet.name] = result.misfit
            self.downweighted += result.downweighted
            self.contradicted += result.contradicted
            self.not_converged += not result.solution.converged
            yield maplet

    def verdict(self) -> Verdict:
        """Judge whether the lidar contradicts the heights of maplets."""
        worst = sorted(
            ((misfit, name) for name, misfit in self.misfits.items() if misfit > _CONTRADICTS),
            reverse=True,
        )
        if not worst:
            return Verdict()
        compared = sum(np.isfinite(misfit) for misfit in self.misfits.values())
        most = Severity.REFUSED if len(worst) > 0.5 * compared else Severity.DOUBTFUL
        named = ", ".join(f"{name} ({misfit:.1f} times)" for misfit, name in worst[:_NAMED])
        rest = f" and {len(worst) - _NAMED} more" if len(worst) > _NAMED else ""
        text = (
            f"in {len(worst)} of {compared} maplets the lidar differs from the SPC heights by more "
            f"than {_CONTRADICTS:g} times as much as elsewhere: {named}{rest}"
        )
        return Verdict((Finding(Code.MAPLET_CONTRADICTED, most, text, worst[0][0], _CONTRADICTS),))

    def summary(self, information: SlopeInformation) -> dict[str, Any]:
        """Return what the command prints."""
        total, shape, nan = max(sum(self.sources.values()), 1), information.shape, float("nan")
        return {
            "maplets": len(self.sigma),
            **{f"share_{s.name.lower()}": n / total for s, n in self.sources.items()},
            "median_sigma_m": float(np.median(self.sigma)) if self.sigma else nan,
            "parts_without_lidar": len(self.untied),
            "maplets_with_parts_without_lidar": sorted(set(self.untied)),
            "downweighted_heights": self.downweighted,
            "contradicted_heights": self.contradicted,
            "not_converged": self.not_converged,
            "spc_step_sigma_m": information.step_sigma_m,
            "spc_steep_sigma": information.steep_sigma,
            "spc_bend_sigma": information.bend_sigma,
            "spc_height_sigma_m": information.height_sigma_m,
            "spc_correlated_cells": information.correlated_cells,
            "shape_height_sigma_m": nan if shape is None else shape.height_sigma_m,
            "shape_step_sigma_m": nan if shape is None else shape.step_sigma_m,
        }
