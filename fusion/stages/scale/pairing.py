"""The pairs of a workspace: images, the scans taken with them, and their maplets."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array

from fusion.estimation.verdict import Cause
from fusion.pipeline import StageContext
from fusion.runtime.folders import make_folder
from fusion.runtime.machine import check_grid
from fusion.scaling.geometry import (
    PairFrame,
    PairOptions,
    UnpairedImage,
    frame_of_image,
    maplet_shares,
    pair_size,
)
from fusion.scaling.pairs import (
    Pair,
    PairSources,
    make_pair,
    match_response,
    rematch,
)
from fusion.scene import maplets_around
from fusion.scene.geolocation import geolocator
from fusion.surfacematch import MatchOptions
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings.inputs import SpiceSettings, SpinSettings
from fusion.workspace.settings.processing import ScaleSettings
from lidar.formats.native import iter_scan, scan_summary
from lidar.geolocation import geolocated_by
from lidar.scans import Returns, Scan, join
from spcola.arrays import FloatArray
from spcola.bigmap import make_bigmap
from spcola.errors import InvalidValueError
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid
from spcola.navigation import Offset, Trajectory
from spcola.shape import RayCaster

# Most pairs from which the blur of the whole solution is estimated.
_BLUR_SAMPLE = 24


@dataclass(frozen=True, eq=False)
class Pairing:
    """All pairs of a workspace.

    Attributes
    ----------
    options : PairOptions
    pairs : list of Pair
    left_out : list of UnpairedImage
    blur_cells : float
        Blur of the SPC bigmaps against those of returns that was applied, cells.
    maplets : tuple of str
        The solution's maplets, in the order of the pairs' shares.
    center_sigma : (M, 3) ndarray
        Standard deviation of their centres, body-fixed axes, metres.
    located_within_m : float
        Error of places of geolocated returns by interpolation, metres.
    without_place : dict of str to int
        Number of returns of each scan that cannot be geolocated.
    """

    options: PairOptions
    pairs: list[Pair]
    left_out: list[UnpairedImage]
    blur_cells: float
    maplets: tuple[str, ...]
    center_sigma: FloatArray
    located_within_m: float
    without_place: dict[str, int]


def pair_images(context: StageContext, caster: RayCaster, radius: float) -> Pairing:
    """Pair the bigmaps of all images of a workspace, both at the same resolution.

    Parameters
    ----------
    context : StageContext
    caster : RayCaster
        Ray caster of the SPC shape.
    radius : float
        Mean radius of the body, metres.

    Raises
    ------
    WorkspaceError
        If a grid of the settings does not fit into memory.
    """
    table = context.table(ScaleSettings)
    solution = _Solution.of(context.workspace, table.maplet_sigma_m)
    options = _options(context.workspace, table, radius, solution)
    frames, left_out = _frames(context, caster, options)
    maker = _PairMaker(context, options, frames, solution)
    groups = maker.groups()
    sizes = [float(len(frames)) for frames in groups.values()]
    made = context.stream("pair bigmaps", maker.pairs_of_scan, groups.items(), sizes=sizes)
    groups_made = list(made)
    first = [item for group in groups_made for item in group.items]
    seen = {item.frame.image if isinstance(item, Pair) else item.image for item in first}
    left_out += [
        UnpairedImage(frame.image, Cause.NO_DATA, "no scan was taken with the image")
        for frame in frames
        if frame.image not in seen
    ]
    pairs = [item for item in first if isinstance(item, Pair)]
    sample = pairs[:: max(1, -(-len(pairs) // _BLUR_SAMPLE))]
    blurs = np.array(context.map("compare resolutions", Pair.relative_blur, sample))
    blur = float(np.nanmedian(blurs)) if np.isfinite(blurs).any() else 0.0
    items = context.items
    again = context.map(
        "match pairs",
        lambda pair: items.result(rematch, pair, options, blur_cells=blur),
        pairs,
    )
    left_out += [item for item in (*first, *again) if isinstance(item, UnpairedImage)]
    kept = [item for item in again if isinstance(item, Pair)]
    names = tuple(solution.grids)
    return Pairing(
        options, kept, left_out, blur, names, solution.center_sigma,
        located_within_m=max((group.within_m for group in groups_made), default=0.0),
        without_place={one.scan: one.without_place for one in groups_made if one.without_place},
    )  # fmt: skip


@dataclass(frozen=True)
class SampledPairs:
    """Some pairs that were made and timed.

    Attributes
    ----------
    pairs : int
        Number of images that are to be paired.
    sampled : int
        Number of them that were made.
    before_s, each_s : float
        Time of what comes before the pairs, and of one pair with all workers at work, seconds.
    points : int
        Number of points of a bigmap.
    returns : int
        Of the largest scan, which is read as a whole.
    """

    pairs: int
    sampled: int
    before_s: float
    each_s: float
    points: int
    returns: int


def sampled_pairs(
    context: StageContext, caster: RayCaster, radius: float, *, count: int, seed: int
) -> SampledPairs:
    """Make about `count` of the pairs as :func:`pair_images` does, and time them.

    `seed` chooses the scans from which they are.
    """
    table = context.table(ScaleSettings)
    begun = time.perf_counter()
    solution = _Solution.of(context.workspace, table.maplet_sigma_m)
    options = _options(context.workspace, table, radius, solution)
    frames, _ = _frames(context, caster, options)
    maker = _PairMaker(context, options, frames, solution)
    groups = list(maker.groups().items())
    before = time.perf_counter() - begun
    workers = context.executor.workers
    most = max(1, count // workers)
    order = np.random.default_rng(seed).permutation(len(groups))
    chosen = [(path, members[:most]) for path, members in (groups[k] for k in order[:workers])]
    for path, members in chosen[:1]:
        maker.pairs_of_scan((path, members[:1]))
    begun = time.perf_counter()
    made = list(context.executor.stream(maker.pairs_of_scan, chosen))
    pairs = [item for group in made for item in group.items if isinstance(item, Pair)]
    list(context.executor.stream(lambda pair: rematch(pair, options, blur_cells=0.5), pairs))
    took, sampled = time.perf_counter() - begun, sum(len(members) for _, members in chosen)
    return SampledPairs(
        sum(len(members) for _, members in groups), sampled, before, took / max(sampled, 1),
        (2 * options.half_size + 1) ** 2,
        max((scan_summary(path).count for path, _ in groups), default=0),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _PairsOfScan:
    """Pairs of one scan, and the geolocation of its returns."""

    scan: str
    items: list[Pair | UnpairedImage]
    within_m: float
    without_place: int


@dataclass(frozen=True, eq=False)
class _Solution:
    """The grids of the workspace's maplets, and the sigmas (M, 3) of their centres."""

    grids: dict[str, MapletGrid]
    center_sigma: FloatArray

    @classmethod
    def of(cls, workspace: Workspace, sigma_m: float) -> _Solution:
        """Read all maplets once; centres without a stated sigma get `sigma_m`."""
        grids, stated = {}, []
        for name in workspace.maplet_names():
            maplet = workspace.maplet(name)
            grids[name] = maplet.grid
            stated.append(maplet.center_sigma)
        known = np.array(stated).reshape(-1, 3)
        return cls(grids, np.where(known > 0, known, sigma_m))


def _options(
    workspace: Workspace, table: ScaleSettings, radius: float, solution: _Solution
) -> PairOptions:
    """Return options from the settings; size and GSD by rule if they are 0."""
    middling = float(np.median([grid.gsd for grid in solution.grids.values()]))
    size, gsd = pair_size(radius, middling)
    size, gsd = table.size_m or size, table.gsd_m or gsd
    check_grid(
        (size / 2.0 + table.capture_m) / gsd,
        f"{workspace.root / SETTINGS_FILE}: [scale]",
        "check size_m, gsd_m and capture_m",
    )
    return PairOptions(
        size_m=size,
        gsd_m=gsd,
        match=MatchOptions(
            capture_m=table.capture_m,
            min_coverage=table.min_coverage,
            min_correlation=table.min_correlation,
        ),
        max_emission_deg=table.max_emission_deg,
        max_incidence_deg=table.max_incidence_deg,
    )


def _frames(
    context: StageContext, caster: RayCaster, options: PairOptions
) -> tuple[list[PairFrame], list[UnpairedImage]]:
    """Return the frames of chosen images; without those that miss the body or look obliquely."""
    images = {image.name: image for image in context.workspace.images()}
    found = {name: frame_of_image(image, caster, options) for name, image in images.items()}
    centers = {k: item.grid.center for k, item in found.items() if isinstance(item, PairFrame)}
    chosen = context.chosen(found, centers).values()
    frames = [item for item in chosen if isinstance(item, PairFrame)]
    return frames, [item for item in chosen if isinstance(item, UnpairedImage)]


class _PairMaker:
    """Makes the pairs of one scan at a time, so that only one is in memory."""

    def __init__(
        self,
        context: StageContext,
        options: PairOptions,
        frames: list[PairFrame],
        solution: _Solution,
    ) -> None:
        workspace = context.workspace
        self._items = context.items
        self._workspace, self._options, self._frames = workspace, options, frames
        self._grids = solution.grids
        self._table = context.table(ScaleSettings)
        self._locator = geolocator(
            workspace,
            context.table(SpinSettings),
            context.table(SpiceSettings),
            max_gap_s=self._table.max_gap_s,
        )
        self._trajectory = Trajectory.from_images(workspace.images())
        self._spans = {path: scan_summary(path).time_span for path in workspace.scan_paths()}

    def groups(self) -> dict[Path, list[PairFrame]]:
        """Return the images taken during each scan or, with the reference trajectory, near it."""
        near = self._table.max_gap_s if self._table.trajectory == "reference" else 0.0
        groups: dict[Path, list[PairFrame]] = {}
        for frame in self._frames:
            away = {path: _away(frame.time, span) for path, span in self._spans.items()}
            nearest = min(away, key=lambda path: away[path])
            if away[nearest] <= near:
                groups.setdefault(nearest, []).append(frame)
        return groups

    def pairs_of_scan(self, item: tuple[Path, list[PairFrame]]) -> _PairsOfScan:
        """Read and geolocate one scan, and pair the images taken with it."""
        path, frames = item
        read = join(path.stem, list(iter_scan(path)))
        scan, within = self._locator.located(read)
        offset = None
        if self._table.trajectory == "spc":
            gap = self._table.max_gap_s
            try:
                scan, offset = geolocated_by(scan, self._trajectory, max_gap_s=gap)
            except InvalidValueError as error:
                none: list[Pair | UnpairedImage] = [
                    UnpairedImage(frame.image, Cause.OUTSIDE_STATES, str(error)) for frame in frames
                ]
                return _PairsOfScan(path.stem, none, within, len(read))
            within = max(within, offset.widest(gap))
        items = [self._pair(frame, scan, offset) for frame in frames]
        return _PairsOfScan(path.stem, items, within, len(read) - len(scan))

    def _pair(self, frame: PairFrame, scan: Scan, offset: Offset | None) -> Pair | UnpairedImage:
        around = maplets_around(self._workspace, self._grids, frame.grid)
        spc = self._items.result(make_bigmap, frame.image, frame.grid, around)
        x, y, height = frame.grid.project(scan.points)
        side = frame.grid.half_size + 0.5
        # Only returns on the grid: their times determine on which states the pair depends.
        inside = (np.abs(x) <= side) & (np.abs(y) <= side) & (np.abs(height) < frame.grid.radius)
        chosen = scan.select(inside & (np.abs(scan.time - frame.time) < self._table.max_gap_s))
        chosen = chosen.select(np.all(np.isfinite(chosen.spacecraft), axis=1))
        if not len(chosen):
            none = "there are no returns of that time with a known spacecraft position"
            return UnpairedImage(frame.image, Cause.NO_DATA, none)
        frame = frame.with_station(np.mean(chosen.spacecraft, axis=0))
        place = {name: number for number, name in enumerate(self._grids)}
        maplets = np.zeros(len(place))
        shares = maplet_shares(frame.grid, spc.height, around)
        maplets[[place[maplet.name] for maplet in around]] = shares
        states, response = self._state_response(spc, chosen, offset)
        sources = PairSources(scan.name, states, response, maplets)
        returns = Returns.of_scans([chosen])
        return self._items.result(make_pair, frame, spc, returns, sources, self._options)

    def _state_response(
        self, spc: Maplet, scan: Scan, offset: Offset | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return the share (S,) of each state (or scan) in the returns, and the match's response.

        The response (S, 3, 3) is the change of the match per displacement of each state.
        """
        if offset is None:
            own = np.array([path.stem == scan.name for path in self._spans], dtype=np.float64)
            return own, own[:, None, None] * np.eye(3)
        # The returns of a scan depend on few of hundreds of states: a dense array of millions of
        # returns by all states would take gigabytes.
        shares = state_shares(self._trajectory, offset, scan.time)
        used = np.unique(shares.indices)
        response = np.zeros((shares.shape[1], 3, 3))
        response[used] = match_response(spc, scan.points, shares[:, used].toarray())
        return np.asarray(shares.mean(axis=0)), response


def state_shares(states: Trajectory, offset: Offset, times: FloatArray) -> csr_array:
    """Return the sparse shares (M, S) of S states in places interpolated at times (M,)."""
    known = offset.shares(times).tocoo()
    column = np.searchsorted(states.time, offset.differences.time)[known.col]
    return csr_array((known.data, (known.row, column)), shape=(len(times), len(states)))


def _away(time: float, span: tuple[float, float]) -> float:
    """Return how far a time lies outside a span, s; infinite if the span is not known."""
    if not np.isfinite(span).all():
        return float("inf")
    return max(span[0] - time, time - span[1], 0.0)


def write_pairs(workspace: Workspace, pairs: list[Pair]) -> list[Path]:
    """Write both bigmaps of each pair."""
    files = []
    make_folder(workspace.home / "pairs")
    for pair in pairs:
        for kind, bigmap in (("maplets", pair.spc), ("returns", pair.lidar)):
            path = workspace.pair_path(pair.frame.image, kind)
            write_maplet(path, bigmap)
            files.append(path)
    return files
