"""The ground whose albedo is solved: maplets, placed mapolas, or bigmaps; read and written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fusion.pipeline import Subset
from fusion.stages.albedo.placing import PlacedMapola
from fusion.workspace import Workspace, visible_files
from spcola.arrays import FloatArray
from spcola.errors import WorkspaceError
from spcola.formats.image_sigmas import write_albedo_sigma
from spcola.formats.maplets import read_map, read_maplet, write_maplet
from spcola.grids import Maplet, MapletGrid
from spcola.photometry.albedo import AlbedoSolution


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Surfaces by name.

    Parameters
    ----------
    grids : mapping of str to MapletGrid
    files : mapping of str to Path
        The .MAP of each; of placed mapolas none.
    placed : mapping of str to PlacedMapola
    companions : bool
        Whether sigmas of heights are written too: else the parent's are there.
    """

    grids: Mapping[str, MapletGrid]
    files: Mapping[str, Path] = field(default_factory=dict)
    placed: Mapping[str, PlacedMapola] = field(default_factory=dict)
    companions: bool = True

    @classmethod
    def of_maplets(cls, workspace: Workspace) -> Surfaces:
        """Return all maplets of a solution.

        Raises
        ------
        WorkspaceError
            If there are none.
        """
        names = workspace.maplet_names()
        if not names:
            raise WorkspaceError("has no maplets", workspace.root, "make some: spcola spc tile")
        grids = {name: workspace.maplet(name).grid for name in names}
        files = {name: workspace.maplet_path(name) for name in names}
        return cls(grids, files, companions=False)

    @classmethod
    def of_mapolas(cls, placed: list[PlacedMapola]) -> Surfaces:
        """Return mapolas as maplets, by their new names."""
        by_name = {one.maplet.name: one for one in placed}
        return cls({name: one.maplet.grid for name, one in by_name.items()}, placed=by_name)

    @classmethod
    def of_bigmaps(cls, workspace: Workspace) -> Surfaces:
        """Return the bigmaps of fused maplets.

        Raises
        ------
        WorkspaceError
            If there are none.
        """
        files = {path.stem: path for path in visible_files(workspace.home / "bigmaps", ".MAP")}
        if not files:
            raise WorkspaceError(
                "has no bigmaps", workspace.root, f"run: spcola bigmap {workspace.root}"
            )
        return cls({name: read_maplet(path).grid for name, path in files.items()}, files)

    @property
    def centers(self) -> dict[str, FloatArray]:
        """Where each lies, body-fixed, metres."""
        return {name: grid.center for name, grid in self.grids.items()}

    def chosen(self, subset: Subset) -> Surfaces:
        """Return some of them.

        Raises
        ------
        InvalidValueError
            If the subset names none.
        """
        grids = subset.chosen(self.grids, self.centers)
        return Surfaces(grids, self.files, self.placed, self.companions)

    def read(self, name: str) -> Maplet:
        """Read a surface."""
        if name in self.placed:
            return self.placed[name].maplet
        return read_maplet(self.files[name], name=name)

    def write(self, folder: Path, name: str, found: AlbedoSolution) -> None:
        """Write a surface with its albedo: heights as they are, to the byte where they have a file.

        Raises
        ------
        WorkspaceError
            If a file cannot be written.
        """
        path = folder / f"{name}.MAP"
        header = read_map(self.files[name]).header if name in self.files else None
        maplet = found.on(self.read(name))
        write_maplet(path, maplet, header=header, sigma_companion=self.companions)
        write_albedo_sigma(path, found.sigma)
