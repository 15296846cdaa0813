"""The maplets that SPCOLA made in a solution: fused ones, or those solved from images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

from fusion.fusing.maplets import FUSED_HDF5, fused_bigmap, fused_names
from fusion.pipeline.solutions.lidar_content import LidarContent
from fusion.workspace import Workspace, visible_files
from spcola.formats.image_sigmas import slope_sigma_path
from spcola.formats.maplets import read_maplet, sigma_path
from spcola.grids import Maplet, MapletGrid

__all__ = ["MadeMaplets"]


@dataclass(frozen=True)
class MadeMaplets:
    """Maplets with heights, sigmas and albedo that bigmaps and products are made of.

    Fused maplets if there are any. Else those of the solution that were solved from images, next to
    which a .SSG lies; of these no sources or counts of returns are known.

    Parameters
    ----------
    workspace : Workspace
    kind : {"fused", "solved"}
    names : tuple of str
    """

    workspace: Workspace
    kind: Literal["fused", "solved"]
    names: tuple[str, ...]

    @classmethod
    def of(cls, workspace: Workspace) -> Self:
        """Find them; there may be none."""
        folder = workspace.home / "fused"
        if (folder / FUSED_HDF5).is_file():
            return cls(workspace, "fused", tuple(fused_names(folder)))
        if names := workspace.fused_names():
            return cls(workspace, "fused", tuple(names))
        solved = {path.stem for path in visible_files(workspace.home / "MAPFILES", ".SSG")}
        names = [name for name in workspace.maplet_names() if name in solved]
        return cls(workspace, "solved", tuple(names))

    @property
    def missing(self) -> str:
        """Why nothing can be made of them, with what to do; empty if it can."""
        if self.names:
            return ""
        root = self.workspace.root
        return (
            f"there are no fused maplets; run: spcola fuse {root} (or solve maplets from images: "
            f"spcola spc lithos {root})"
        )

    @property
    def paths(self) -> list[Path]:
        """Their files."""
        if self.kind == "fused":
            return self.workspace.fused_paths()
        found = []
        for name in self.names:
            path = self.workspace.maplet_path(name)
            found += [path, sigma_path(path), slope_sigma_path(path)]
        return [path for path in found if path.is_file()]

    @property
    def source(self) -> Literal["SPO", "SPC"]:
        """What their heights come from, as products state it: images alone, or lidar too."""
        lidar = self.kind == "fused" or LidarContent.of(self.workspace) is not None
        return "SPO" if lidar else "SPC"

    def path(self, name: str) -> Path:
        """Return the .MAP of one of them."""
        fused = self.kind == "fused"
        return self.workspace.fused_path(name) if fused else self.workspace.maplet_path(name)

    def read(self, name: str) -> Maplet:
        """Read one of them: a fused one has sources and counts too."""
        fused = self.kind == "fused"
        return self.workspace.fused(name) if fused else self.workspace.maplet(name)

    def grids(self) -> dict[str, MapletGrid]:
        """Return their grids by name."""
        return {name: self.read(name).grid for name in self.names}

    def bigmap(self, path: Path) -> Maplet:
        """Read a bigmap that was made of them: of fused ones with sources and counts."""
        bigmap = read_maplet(path)
        if self.kind == "solved":
            return bigmap
        return fused_bigmap(bigmap, map(self.workspace.fused, self.names))
