"""Scale: lidar ranges against the SPC solution, by paired bigmaps or by single shots."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from fusion.locating import kernel_paths, turning
from fusion.memory import check_grid
from fusion.registration.match import MatchOptions
from fusion.scaling.joint import ScaleOptions, estimate_scale
from fusion.scaling.pairs import (
    LeftOut,
    Pair,
    PairFrame,
    PairOptions,
    blur_of,
    frame_of_image,
    make_pair,
    pair_observations,
    seen_from,
    sharpened,
)
from fusion.scaling.shots import ShotComparison, check_longitude, compare_shots, join_shots
from fusion.scaling.summary import (
    consistency,
    longitude_json,
    per_pair,
    per_shot,
    scale_json,
    silent_pairs,
    unobserved_json,
)
from fusion.settings import Settings
from fusion.stages.base import StageContext, StageResult
from fusion.surfaces import maplets_around
from fusion.tables import BodySettings, ScaleSettings, SpiceSettings, SpinSettings, Table
from fusion.workspace import SETTINGS_FILE, Workspace, make_folder
from lidar.formats.native import iter_scan, scan_summary
from lidar.reprojection import reproject, scan_trajectory
from lidar.returns import Returns
from lidar.scan import Scan, join
from spcola.arrays import FloatArray
from spcola.bigmap import make_bigmap
from spcola.errors import InvalidValueError
from spcola.formats.map import write_maplet
from spcola.maplet import MapletGrid
from spcola.rays import RayCaster
from spcola.trajectory import Offset, Trajectory


@dataclass(frozen=True)
class ScaleStage:
    """Scans, images and SPC surface → scale.json and pairs/."""

    name: str = "scale"
    version: int = 5
    tables: tuple[type[Table], ...] = (
        ScaleSettings,
        BodySettings,
        SpinSettings,
        SpiceSettings,
    )

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why there is no scale to be found."""
        if not workspace.scan_names():
            return f"there are no scans; run: spcola import {workspace.root} FILE"
        if not workspace.has_shape():
            return "there is no shape in SHAPEFILES to cast rays on"
        if settings.scale.method == "pairs":
            if not workspace.image_names():
                return "there are no images in SUMFILES to pair; use --method shots"
            if not workspace.maplet_names():
                return "there are no maplets in MAPFILES to pair; use --method shots"
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return scans, shape, images, the registration if there is one; for pairs maplets."""
        paths = [*workspace.scan_paths(), workspace.shape_path()]
        paths += kernel_paths(workspace, settings.spice)
        if workspace.registration_path.is_file():
            paths.append(workspace.registration_path)
        paths += [workspace.image_path(name) for name in workspace.image_names()]
        if settings.scale.method == "pairs":
            paths += workspace.maplet_files()
        return paths

    def run(self, context: StageContext) -> StageResult:
        """Compare, estimate jointly, write; that nothing can be compared is written too."""
        workspace, table = context.workspace, context.table(ScaleSettings)
        shape = workspace.shape()
        radius = context.table(BodySettings).mean_radius_m or shape.mean_radius
        caster = RayCaster(shape)
        files: list[Path] = []
        if table.method == "shots":
            content = _shots(context, caster, radius)
        else:
            content, files = _pairs(context, caster, radius)
        if workspace.registration_path.is_file():
            registration = workspace.read_json(workspace.registration_path.name)
            content["registration_consistency"] = consistency(content, registration)
        path = context.write_json(workspace.scale_path.name, content)
        summary = {k: v for k, v in content.items() if k not in _LONG}
        return StageResult((path, *files), summary)


STAGE = ScaleStage()

_LONG = frozenset({"per_pair", "per_shot", "covariance", "parameters"})


def _scale_options(table: ScaleSettings) -> ScaleOptions:
    return ScaleOptions(
        center_prior_m=table.center_prior_m,
        meridian_prior_deg=table.meridian_prior_deg,
        pole_prior_deg=table.pole_prior_deg,
        range_bias_prior_m=table.range_bias_prior_m,
        single_sigma_m=table.single_sigma_m,
        state_sigma_m=table.state_sigma_m,
        day_sigma_m=table.day_sigma_m,
        reject=table.reject_sigmas,
    )


def _shots(context: StageContext, caster: RayCaster, radius: float) -> dict[str, Any]:
    """Single shots of all scans against the shape."""
    workspace, table = context.workspace, context.table(ScaleSettings)
    turn = turning(workspace, context.table(SpinSettings), context.table(SpiceSettings))
    scans = _thinned(workspace, turn, table.max_shots)
    located = table.trajectory if workspace.image_names() else "reference"
    states = Trajectory.from_images(workspace.images()) if located == "spc" else None

    def one(scan: Scan) -> ShotComparison:
        if states is None:
            return compare_shots(scan, caster, trajectory=located)
        again, shares = _relocated(scan, states, table.max_gap_s)
        return compare_shots(again, caster, trajectory=located, shares=shares)

    compared = join_shots(context.map("cast shots", one, scans))
    scan = join("shots", scans)
    if len(compared.observations) < 2:
        return unobserved_json(
            "shots",
            located,
            f"{compared.missed} of {len(scan)} shots do not meet the shape, or have no spacecraft "
            "position; check that shots and shape are in one frame and unit",
        )
    estimate = estimate_scale(compared.observations, options=_scale_options(table))
    check = check_longitude(scan, caster)
    content = scale_json(compared.observations, estimate, mean_radius=radius)
    if located != table.trajectory:
        content["reasons"].append(
            "trajectory: there are no images with SPC states, so the shots are located by their "
            "own reference trajectory: epsilon is that of the shape alone"
        )
    if check.misfit:
        content["reasons"].append(
            f"misfit: turned by {check.best_deg:+.0f} deg about Z the shots scatter by "
            f"{check.best_m:.2f} m instead of {check.here_m:.2f} m (p = {check.p_value:.1e})"
        )
    content["longitude_check"] = longitude_json(check)
    content["missed"] = compared.missed
    content["per_shot"] = per_shot(compared, estimate)
    return content


def _relocated(scan: Scan, states: Trajectory, max_gap_s: float) -> tuple[Scan, FloatArray]:
    """Locate shots by SPC states, and tell on which of these (N, S) each leans.

    No shot is left where no state falls into the scan.
    """
    try:
        offset = states.offset_from(scan_trajectory(scan), max_gap_s=max_gap_s)
    except InvalidValueError:
        return scan.select(np.zeros(len(scan), dtype=bool)), np.zeros((0, len(states)))
    again = reproject(scan, states, max_gap_s=max_gap_s)
    return again, state_shares(states, offset, again.time).toarray()


def state_shares(states: Trajectory, offset: Offset, times: FloatArray) -> csr_array:
    """Share (M, S), sparse, that each of S states has in what is located at times (M,)."""
    known = offset.shares(times).tocoo()
    column = np.searchsorted(states.time, offset.differences.time)[known.col]
    return csr_array((known.data, (known.row, column)), shape=(len(times), len(states)))


def _thinned(workspace: Workspace, turn: Callable[[Scan], Scan], most: int) -> list[Scan]:
    """The shots of each scan where they are now, evenly thinned to about `most` in all."""
    paths = workspace.scan_paths()
    total = sum(scan_summary(path).count for path in paths)
    step = max(1, -(-total // most))
    return [
        turn(
            join(
                path.stem,
                [part.select(np.arange(0, len(part), step)) for part in iter_scan(path)],
            )
        )
        for path in paths
    ]


def _pairs(
    context: StageContext, caster: RayCaster, radius: float
) -> tuple[dict[str, Any], list[Path]]:
    """Paired bigmaps of all images."""
    workspace, table = context.workspace, context.table(ScaleSettings)
    options = PairOptions(
        size_m=table.size_m,
        gsd_m=table.gsd_m,
        match=MatchOptions(
            capture_m=table.capture_m,
            min_coverage=table.min_coverage,
            min_correlation=table.min_correlation,
        ),
    )
    check_grid(
        (table.size_m / 2.0 + table.capture_m) / table.gsd_m,
        f"{workspace.root / SETTINGS_FILE}: [scale]",
        "check size_m, gsd_m and capture_m",
    )
    frames, left_out = _frames(workspace, caster, options)
    maker = _PairMaker(context, options, frames)
    groups = maker.groups()
    made = context.stream("pair bigmaps", maker.pairs_of_scan, groups.items(), total=len(groups))
    first = [item for group in made for item in group]
    seen = {item.frame.image for item in first if isinstance(item, Pair)}
    seen |= {item.image for item in first if isinstance(item, LeftOut)}
    left_out += [
        LeftOut(frame.image, "no scan was taken with the image")
        for frame in frames
        if frame.image not in seen
    ]
    pairs = [item for item in first if isinstance(item, Pair)]
    left_out += [item for item in first if isinstance(item, LeftOut)]
    blurs = np.array(
        context.map("compare resolutions", blur_of, pairs[:: max(1, -(-len(pairs) // 24))])
    )
    blur = float(np.nanmedian(blurs)) if np.isfinite(blurs).any() else 0.0
    again = context.map(
        "match pairs", lambda pair: sharpened(pair, options, blur_cells=blur), pairs
    )
    pairs = [item for item in again if isinstance(item, Pair)]
    left_out += [item for item in again if isinstance(item, LeftOut)]
    if len(pairs) < 2:
        why = "; ".join(sorted({item.reason for item in left_out})) or "there are no images"
        content = unobserved_json(
            "pairs",
            table.trajectory,
            f"{len(pairs)} of {len(pairs) + len(left_out)} images give a pair ({why}); add scans "
            "taken with the images, or widen [scale] capture_m",
        )
        return content | {"per_pair": silent_pairs(left_out)}, _write_pairs(workspace, pairs)
    observations = pair_observations(pairs, table.trajectory)
    estimate = estimate_scale(observations, options=_scale_options(table))
    content = scale_json(observations, estimate, mean_radius=radius)
    content["blur_cells"] = blur
    content["per_pair"] = per_pair(pairs, left_out, observations, estimate)
    return content, _write_pairs(workspace, pairs)


def _frames(
    workspace: Workspace, caster: RayCaster, options: PairOptions
) -> tuple[list[PairFrame], list[LeftOut]]:
    """Where all images look; those that look past the body are left out."""
    found = [frame_of_image(image, caster, options) for image in workspace.images()]
    frames = [item for item in found if isinstance(item, PairFrame)]
    return frames, [item for item in found if isinstance(item, LeftOut)]


def _write_pairs(workspace: Workspace, pairs: list[Pair]) -> list[Path]:
    """Write both bigmaps of each pair."""
    files = []
    make_folder(workspace.root / "pairs")
    for pair in pairs:
        for kind, bigmap in (("maplets", pair.spc), ("returns", pair.lidar)):
            path = workspace.pair_path(pair.frame.image, kind)
            write_maplet(path, bigmap)
            files.append(path)
    return files


class _PairMaker:
    """Makes the pairs of one scan at a time, so that no more than that is in memory."""

    def __init__(
        self, context: StageContext, options: PairOptions, frames: list[PairFrame]
    ) -> None:
        workspace = context.workspace
        self._workspace, self._options, self._frames = workspace, options, frames
        self._table = context.table(ScaleSettings)
        self._turn = turning(workspace, context.table(SpinSettings), context.table(SpiceSettings))
        self._grids: dict[str, MapletGrid] = {
            name: workspace.maplet(name).grid for name in workspace.maplet_names()
        }
        self._trajectory = Trajectory.from_images(workspace.images())
        self._spans = {path: scan_summary(path).time_span for path in workspace.scan_paths()}

    def groups(self) -> dict[Path, list[PairFrame]]:
        """The images of each scan: those taken during it (with another trajectory, near it)."""
        near = self._table.max_gap_s if self._table.trajectory == "reference" else 0.0
        groups: dict[Path, list[PairFrame]] = {}
        for frame in self._frames:
            away = {path: _away(frame.time, span) for path, span in self._spans.items()}
            nearest = min(away, key=lambda path: away[path])
            if away[nearest] <= near:
                groups.setdefault(nearest, []).append(frame)
        return groups

    def pairs_of_scan(self, item: tuple[Path, list[PairFrame]]) -> list[Pair | LeftOut]:
        """Read and locate one scan, and pair the images that were taken with it."""
        path, frames = item
        scan = self._turn(join(path.stem, list(iter_scan(path))))
        offset = None
        if self._table.trajectory == "spc":
            gap = self._table.max_gap_s
            try:
                offset = self._trajectory.offset_from(scan_trajectory(scan), max_gap_s=gap)
            except InvalidValueError as error:
                return [LeftOut(frame.image, str(error)) for frame in frames]
            scan = reproject(scan, self._trajectory, max_gap_s=gap)
        return [self._pair(frame, scan, offset) for frame in frames]

    def _pair(self, frame: PairFrame, scan: Scan, offset: Offset | None) -> Pair | LeftOut:
        around = maplets_around(self._workspace, self._grids, frame.grid)
        spc = make_bigmap(frame.image, frame.grid, around)
        x, y, height = frame.grid.project(scan.points)
        side = frame.grid.half_size + 0.5
        # Only what lies on the grid: its times say on which states the pair leans.
        inside = (np.abs(x) <= side) & (np.abs(y) <= side) & (np.abs(height) < frame.grid.radius)
        chosen = scan.select(inside & (np.abs(scan.time - frame.time) < self._table.max_gap_s))
        chosen = chosen.select(np.all(np.isfinite(chosen.spacecraft), axis=1))
        if not len(chosen):
            return LeftOut(frame.image, "no return of that time and a known station lies there")
        frame = seen_from(frame, np.mean(chosen.spacecraft, axis=0))
        shares = self._shares(scan.name, chosen.time, offset)
        return make_pair(frame, spc, Returns.of_scans([chosen]), shares, self._options)

    def _shares(self, scan: str, times: FloatArray, offset: Offset | None) -> FloatArray:
        """Share of each image's state in where the returns lie; of each scan without states."""
        if offset is None:
            return np.array([path.stem == scan for path in self._spans], dtype=np.float64)
        shares: FloatArray = state_shares(self._trajectory, offset, times).mean(axis=0)
        return shares


def _away(time: float, span: tuple[float, float]) -> float:
    """How far a time lies outside of a span, s; infinite where the span is not known."""
    if not np.isfinite(span).all():
        return float("inf")
    return max(span[0] - time, time - span[1], 0.0)
