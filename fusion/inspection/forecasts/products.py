"""Forecasts of the stages that read files, join surfaces or write products."""

from __future__ import annotations

import hashlib
import time

from fusion.inspection.forecasts.situation import Situation
from fusion.inspection.forecasts.values import Basis, StageForecast
from fusion.pipeline import Stage
from fusion.stages.made_maplets import MadeMaplets
from fusion.workspace.settings.processing import BigmapSite
from spcola.bigmap import BigmapOptions

# Bytes that are digested to time it.
_DIGESTED = 1 << 25
# Bytes of one point: in memory, of one maplet file with its sigmas, of the layers of a release.
_POINT_BYTES, _MAP_BYTES, _LAYER_BYTES = 2500.0, 7.0, 32.0
# Of one point while its products are written, and while layers of all are.
_PRODUCT_BYTES = 9000.0
# Three bigmaps of a site; that of returns takes as long as so many others.
_BIGMAPS, _OF_RETURNS = 3, 2.0
# Maplets and fused maplets are read, products are digested and layers written one by one.
_READING_S, _FURTHER = 4e-3, 1.4
# The report takes as long as so many that show a single place, and has so many bytes.
_PLACES, _REPORT_BYTES, _PAGE_WORKER_BYTES = 7.0, 2e6, 2e8


def ingest_forecast(situation: Situation, stage: Stage) -> StageForecast:
    """Return the forecast of the digests of scans, for which nothing is written."""
    paths = situation.workspace.scan_paths()
    size = sum(
        path.stat().st_size for path in stage.inputs(situation.workspace, situation.settings)
    )
    block, begun = bytes(_DIGESTED), time.perf_counter()
    hashlib.sha256(block).digest()
    each = (time.perf_counter() - begun) / _DIGESTED
    basis = Basis.SAMPLE if stage.name in situation.ready else Basis.SYNTHETIC
    return StageForecast(
        stage.name, len(paths), seconds=each * size / situation.workers,
        workers=situation.workers, basis=basis,
    )  # fmt: skip


def bigmap_forecast(situation: Situation, stage: Stage) -> StageForecast:
    """Return the forecast of the bigmaps of all sites, from one of the size of a maplet."""
    table = situation.settings.bigmap
    points = [_points(situation, site) for site in table.sites]
    options = BigmapOptions(constraint_fraction=table.constraint_fraction)
    each = situation.synthetic.joining(options)
    own = float(situation.usual_mapola.size**2)
    work = sum(points) / own * each * (_BIGMAPS - 1 + _OF_RETURNS)
    work += 2.0 * _READING_S * len(situation.grids)
    return StageForecast(
        stage.name, len(points), 0, work, _POINT_BYTES * max(points, default=0.0),
        situation.workers, _BIGMAPS * _MAP_BYTES * sum(points), Basis.SYNTHETIC,
        shared_bytes=situation.shape_bytes,
    )  # fmt: skip


def release_forecast(situation: Situation, stage: Stage) -> StageForecast:
    """Return the forecast of writing the products of every fused maplet and bigmap."""
    table, own = situation.settings.release, float(situation.usual_mapola.size**2)
    sites = [_points(situation, site) / own for site in situation.settings.bigmap.sites]
    ready = stage.name in situation.ready
    count = len(MadeMaplets.of(situation.workspace).names) if ready else len(situation.grids)
    each, size = situation.synthetic.products(list(table.products))
    maps = "map" in table.products
    size += (_MAP_BYTES + _LAYER_BYTES) * own if maps else 0.0
    times = count + sum(sites)
    return StageForecast(
        stage.name, count + len(sites), 0, _FURTHER * times * each, _PRODUCT_BYTES * own,
        situation.workers, times * size, Basis.SYNTHETIC,
    )  # fmt: skip


def report_forecast(situation: Situation, stage: Stage) -> StageForecast:
    """Return the forecast of the page, whose figures show a limited number of places."""
    return StageForecast(
        stage.name, 1, 0, _PLACES * situation.synthetic.report(), _PAGE_WORKER_BYTES, 1,
        _REPORT_BYTES, Basis.SYNTHETIC,
    )  # fmt: skip


def _points(situation: Situation, site: BigmapSite) -> float:
    """Return the number of points of the bigmap of a site."""
    gsd = site.gsd_m or situation.usual_mapola.gsd
    size = site.size_m or 0.5 * situation.radius
    return (2.0 * max(2, round(size / gsd / 2.0)) + 1.0) ** 2
