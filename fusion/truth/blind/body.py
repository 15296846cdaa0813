"""The true body of a mission."""

from __future__ import annotations

from fusion.truth.blind.settings import BlindSettings
from fusion.truth.presets import MissionSettings
from spcola.truth.body import TruthBody
from spcola.truth.solid import SolidBody


def truth_body(settings: MissionSettings) -> TruthBody:
    """Return the body of a mission: one radius in each direction, or a mesh that may overhang.

    Raises
    ------
    WorkspaceError, FormatError
        If it is built on a file that cannot be read.
    """
    if not isinstance(settings, BlindSettings):
        return TruthBody(settings.body)
    base = None if settings.base is None else settings.base.mesh()
    return SolidBody(settings.body, settings.solid, base=base)
