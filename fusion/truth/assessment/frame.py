"""The planted values in the frame of a solution that was made from the imported one."""

from __future__ import annotations

from dataclasses import replace

from fusion.pipeline.solutions import lineage
from fusion.truth.planted import Planted
from fusion.workspace import Workspace


def planted_in(planted: Planted, workspace: Workspace) -> Planted:
    """Return the planted values for the solution of a workspace.

    The mission plants ``V_spc = T + R V_lidar / (1 + ε)`` in the imported solution. A solution
    whose lengths were multiplied by f has ``f T`` and ``(1 + ε) / f`` instead.

    Parameters
    ----------
    planted : Planted
    workspace : Workspace

    Raises
    ------
    WorkspaceError
        If the solution, or one that it was made from, is gone or damaged.
    """
    factor = 1.0
    for record in lineage(workspace):
        factor *= 1.0 + float(record.facts.get("epsilon", 0.0))
    if factor == 1.0:
        return planted
    settings = planted.settings
    x, y, z = settings.translation_m
    moved = replace(
        settings,
        epsilon=(1.0 + settings.epsilon) / factor - 1.0,
        translation_m=(factor * x, factor * y, factor * z),
    )
    return replace(planted, settings=moved)
