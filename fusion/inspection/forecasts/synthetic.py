"""Costs of made-up items of a given size, for stages whose inputs do not exist yet."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy import ndimage

from fusion.fusing import Constraints, FuseInput, fuse_maplet
from fusion.fusing.maplets import FusedMaplet, Source
from fusion.fusing.uncertainty import DEFAULT_INFORMATION
from fusion.inspection.forecasts.timing import seconds_of
from fusion.products import Provenance
from fusion.products.formats import write_fits_dtm, write_geotiff, write_obj, write_ply
from fusion.registration.judging import UNRELATED, ReliefPair, common_relief
from fusion.report import ReportData, Surfaces, make_report
from fusion.surfacematch import MatchOptions, Surface, match_surfaces
from spcola.bigmap import BigmapOptions, make_bigmap
from spcola.grids import Maplet, MapletGrid

_WRITERS = {"fits": write_fits_dtm, "geotiff": write_geotiff, "obj": write_obj, "ply": write_ply}
_RADIUS, _SIGMA = 250.0, 0.05
_PROVENANCE = Provenance("body", {}, {})


@dataclass(frozen=True)
class SyntheticCosts:
    """Costs of made-up items: rough ground that lidar and SPC show alike.

    Parameters
    ----------
    half_size : int
        Of maplets and mapolas.
    gsd : float
        Their ground sample distance, metres.
    workers : int
    """

    half_size: int
    gsd: float
    workers: int

    @cached_property
    def _maplet(self) -> Maplet:
        """A maplet with relief of a few cells."""
        grid = MapletGrid.facing([_RADIUS, 0.0, 0.0], [1.0, 0.0, 0.0], self.gsd, self.half_size)
        rough = np.random.default_rng(1).normal(size=grid.shape)
        height = 10.0 * self.gsd * ndimage.gaussian_filter(rough, 3.0)
        return Maplet("SPC", grid, height, sigma=np.full(grid.shape, _SIGMA))

    @cached_property
    def _fused(self) -> FusedMaplet:
        """The same maplet, of lidar throughout."""
        spc = self._maplet
        count = np.ones(spc.grid.shape, np.int32)
        source = np.full(spc.grid.shape, int(Source.LIDAR))
        return FusedMaplet(
            "SPC", spc.grid, spc.height, spc.albedo, spc.sigma, np.full(3, _SIGMA), count, source
        )

    def match(self, options: MatchOptions) -> float:
        """Seconds of the match of a mapola with a maplet."""
        spc = self._maplet
        lidar, smooth = (
            Surface(spc.height, spc.sigma),
            Surface(ndimage.gaussian_filter(spc.height, 1.0), spc.sigma),
        )
        return seconds_of(
            lambda: match_surfaces("SPC", spc.grid, lidar, smooth, options=options), self.workers
        )

    def relief(self, count: int, capture_m: float) -> float:
        """Seconds of comparing the relief of so many mapolas with that of SPC and elsewhere."""
        spc = self._maplet
        reach = max(1, int(np.ceil(capture_m / self.gsd)))
        pair = ReliefPair(spc.height, spc.height, np.zeros(2), reach)
        seconds = seconds_of(lambda: common_relief([pair, pair]), self.workers)
        return seconds * count * (count + UNRELATED) / (2.0 * (2.0 + UNRELATED))

    def report(self) -> float:
        """Seconds of a report that shows a single place."""
        fused = self._fused
        data = ReportData("body", surfaces=(Surfaces(fused, fused.height, fused.height),))
        return seconds_of(lambda: make_report(data), 1)

    def fusion(self) -> float:
        """Seconds of fusing a maplet."""
        spc = self._maplet
        known = Constraints(spc.height, spc.sigma, np.ones(spc.grid.shape, np.int32))
        parts = FuseInput("SPC", spc.grid, spc, known, spc.height, 1e-4 * np.eye(3))
        return seconds_of(lambda: fuse_maplet(parts, DEFAULT_INFORMATION), self.workers)

    def joining(self, options: BigmapOptions) -> float:
        """Seconds of a bigmap of the size of one maplet, on which nine maplets lie."""
        spc = self._maplet
        return seconds_of(
            lambda: make_bigmap("SPC", spc.grid, [spc] * 9, options=options), self.workers
        )

    def products(self, kinds: list[str]) -> tuple[float, float]:
        """Seconds of writing the products of one maplet, and their bytes."""
        with tempfile.TemporaryDirectory() as folder:

            def write() -> None:
                for kind in kinds:
                    if kind in _WRITERS:
                        _WRITERS[kind](Path(folder) / f"product.{kind}", self._fused, _PROVENANCE)

            seconds = seconds_of(write, 1)
            size = sum(path.stat().st_size for path in Path(folder).iterdir())
        return seconds, float(size)
