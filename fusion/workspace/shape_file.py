"""The shape model of a solution: which file it is, and whether its unit fits the maplets."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fusion.workspace.listing import visible_files
from spcola.errors import WorkspaceError
from spcola.grids import Maplet
from spcola.shape import Mesh

# Surface points lie within this factor of the mean radius; a wrong unit (metres for kilometres)
# is a factor of a thousand.
_UNIT_FACTOR = 30.0


def shape_file(folder: Path) -> Path:
    """Return the file of the shape model in a folder: SHAPE.TXT, or the only file there is.

    Raises
    ------
    WorkspaceError
        If there is none, or several.
    """
    files = visible_files(folder)
    if len(files) == 1:
        return files[0]
    if folder / "SHAPE.TXT" in files:
        return folder / "SHAPE.TXT"
    if not files:
        raise WorkspaceError("holds no shape", folder, "put one there, or init with --shape")
    names = ", ".join(file.name for file in files)
    raise WorkspaceError(f"holds several shapes ({names})", folder, "set [body] shape")


def check_unit(mesh: Mesh, path: Path, maplet: Maplet) -> None:
    """Refuse a shape whose size does not fit a maplet; `path` is its file.

    Raises
    ------
    WorkspaceError
    """
    away = float(np.linalg.norm(maplet.grid.center))
    if not mesh.mean_radius / _UNIT_FACTOR < away < mesh.mean_radius * _UNIT_FACTOR:
        raise WorkspaceError(
            f"has a mean radius of {mesh.mean_radius:.4g} m, but the maplet {maplet.name} "
            f"lies {away:.4g} m from the centre",
            path,
            "check the units: [body] shape_unit for an OBJ or PLY, km in all SPC files",
        )
