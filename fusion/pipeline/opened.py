"""The catalogue of a solution, opened for one program at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

from fusion.pipeline.catalog.catalog import Catalog
from fusion.pipeline.catalog.records import RECORD_FOLDER
from fusion.runtime.folders import LOCK_FILE, clear_leftovers, locked
from fusion.workspace import OWN_FOLDERS, Workspace


@contextmanager
def opened(workspace: Workspace, *, wait: bool = False) -> Iterator[Catalog]:
    """Open the catalogue of a solution, and lock the solution meanwhile.

    Parameters
    ----------
    workspace : Workspace
    wait : bool
        Whether to wait while another program works with this solution.

    Raises
    ------
    WorkspaceError
        If another program works with it, or it cannot be written.
    """
    own = [workspace.home / name for name in (*OWN_FOLDERS, RECORD_FOLDER)]
    # Bigmaps of maplets and of returns lie in folders inside.
    inner = [folder for outer in own for folder in outer.glob("*/")]
    with locked(workspace.home / LOCK_FILE, wait=wait):
        clear_leftovers([workspace.home, *own, *inner])
        with closing(Catalog(workspace)) as catalog:
            catalog.restore()
            yield catalog
