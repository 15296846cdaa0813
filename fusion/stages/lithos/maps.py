"""Maps and terrain models of others as constraining heights."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fusion.products.formats import TerrainRaster, read_fits_dtm
from spcola.errors import FormatError, SpcolaError, WorkspaceError
from spcola.formats.maplets import read_maplet
from spcola.grids import Maplet, overlaps, project_maplet
from spcola.photometry.photoclinometry import HeightConstraint

# Points of a map that share one error.
_COMMON = 100.0
# First bytes of a TIFF and a BigTIFF, of either byte order.
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


@dataclass(frozen=True, eq=False)
class ExternalMap:
    """A map or terrain model.

    Parameters
    ----------
    path : Path
    surface : Maplet or TerrainRaster
    sigma_m : float, optional
        Sigma of its heights where it states none, metres.
    """

    path: Path
    surface: Maplet | TerrainRaster
    sigma_m: float | None = None

    @property
    def name(self) -> str:
        """What its heights are called."""
        return self.path.name

    @classmethod
    def read(cls, path: Path, sigma_m: float | None) -> ExternalMap:
        """Read a GeoTIFF, a FITS of a release, or a .MAP with its .SIG.

        Raises
        ------
        WorkspaceError
            If there is no such file.
        FormatError
            If it is none of these, or damaged, or no sigma of its heights is known.
        """
        surface = _surface_of(path)
        stated = isinstance(surface, Maplet) and np.isfinite(surface.sigma).any()
        if sigma_m is None and not stated:
            raise FormatError(
                "states no sigma of its heights", path, "give one: --map-sigma METRES"
            )
        return cls(path, surface, sigma_m)

    def constraint(self, start: Maplet) -> HeightConstraint | None:
        """Return its heights on the grid of a maplet; None where it has none.

        A map that is coarser than the grid has as many errors as it has points.

        Parameters
        ----------
        start : Maplet
            Heights known so far.
        """
        grid, surface = start.grid, self.surface
        unknown = np.nan if self.sigma_m is None else self.sigma_m
        if isinstance(surface, TerrainRaster):
            gsd, height = surface.gsd, surface.heights(start)
            sigma = np.full(grid.shape, unknown)
        else:
            if not overlaps(grid, surface.grid):
                return None
            there = project_maplet(surface, grid)
            gsd, height = surface.grid.gsd, there.height
            sigma = np.where(np.isfinite(there.sigma), there.sigma, unknown)
        if not (np.isfinite(height) & np.isfinite(sigma)).any():
            return None
        common = _COMMON * max(1.0, gsd / grid.gsd) ** 2
        return HeightConstraint.of_sigma(self.name, height, sigma, common=common)


def read_maps(paths: Iterable[Path], sigma_m: float | None) -> tuple[ExternalMap, ...]:
    """Read maps, each as :meth:`ExternalMap.read`."""
    return tuple(ExternalMap.read(path, sigma_m) for path in paths)


def _surface_of(path: Path) -> Maplet | TerrainRaster:
    """Return what a file contains, by its first bytes."""
    try:
        with path.open("rb") as file:
            begin = file.read(8)
    except OSError as error:
        raise WorkspaceError(f"cannot be read ({error.strerror})", path) from error
    if begin.startswith(_TIFF):
        return TerrainRaster.open(path)
    if begin.startswith(b"SIMPLE"):
        return read_fits_dtm(path)
    try:
        return read_maplet(path)
    except SpcolaError as error:
        if path.suffix.upper() == ".MAP":
            raise
        raise FormatError(
            "is no map", path, "give a GeoTIFF, a FITS of a release, or a .MAP"
        ) from error
