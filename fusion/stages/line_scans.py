"""Line-scan images that a stage leaves out: their states are known, but for each line."""

from __future__ import annotations

from enum import StrEnum
from typing import Any

from fusion.workspace import Workspace

__all__ = ["NOT_USED", "NotUsed", "line_scans_not_used", "no_images"]

NOT_USED = "images_not_used"
"""Key of summaries under which a stage names images that it leaves out."""


class NotUsed(StrEnum):
    """Codes of why a stage does not use images."""

    LINE_SCAN = "line-scan"


def no_images(workspace: Workspace) -> str:
    """Return that a workspace has no image that a stage can use; empty if it has one."""
    if workspace.image_names():
        return ""
    if workspace.line_scan_names():
        return "there are only line-scan images in SUMFILES, which have a state for each line"
    return "there are no images in SUMFILES"


def line_scans_not_used(workspace: Workspace) -> dict[str, Any]:
    """Return what a stage that reads images states of line scans, under ``images_not_used``.

    Empty if there are none. Stages need one state for an image, as .SUM files have it.
    """
    names = workspace.line_scan_names()
    if not names:
        return {}
    shown = ", ".join(names[:3]) + (", …" if len(names) > 3 else "")
    count = f"{len(names)} line-scan images have" if len(names) > 1 else "1 line-scan image has"
    text = f"{count} a state for each line, which this stage does not use: {shown}"
    return {NOT_USED: {"code": NotUsed.LINE_SCAN, "images": names, "text": text}}
