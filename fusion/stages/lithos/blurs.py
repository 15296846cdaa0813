"""Blur of the images of a workspace, from a table of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from fusion.workspace import Workspace
from spcola.formats.image_blurs import read_image_blurs
from spcola.photometry.photoclinometry import PhotoclinometryOptions

__all__ = ["blur_path", "with_blurs"]


def blur_path(workspace: Workspace, table: str) -> Path | None:
    """Return the path of a table of blur as settings name it; None if they name none."""
    return workspace.root / table if table else None


def with_blurs(
    options: PhotoclinometryOptions, workspace: Workspace, table: str
) -> PhotoclinometryOptions:
    """Return options with the blur of the images of a workspace.

    Parameters
    ----------
    options : PhotoclinometryOptions
    workspace : Workspace
    table : str
        As settings name it.

    Raises
    ------
    FormatError
        As :func:`spcola.formats.image_blurs.read_image_blurs`.
    """
    path = blur_path(workspace, table)
    if path is None:
        return options
    return replace(options, blurs=read_image_blurs(path, workspace.image_names()))
