"""The true body of a mission."""

from __future__ import annotations

import numpy as np

from fusion.truth.blind.settings import BlindSettings
from fusion.truth.presets import MissionSettings
from spcola.errors import SettingsError
from spcola.truth.body import TruthBody
from spcola.truth.solid import SolidBody

# Some 200 bytes each.
_MOST_FEATURES = 2.0e7


def truth_body(settings: MissionSettings) -> TruthBody:
    """Return the body of a mission: one radius in each direction, or a mesh that may overhang.

    Raises
    ------
    SettingsError
        If it has more craters and boulders than memory holds.
    WorkspaceError, FormatError
        If it is built on a file that cannot be read.
    """
    relief, area = settings.body, 4.0 * np.pi * settings.body.radius**2
    features = relief.craters.expected(area) + relief.boulders.expected(area)
    if features > _MOST_FEATURES:
        raise SettingsError(
            f"a body of {relief.radius:,g} m has {features:.2g} of them, which are too many",
            "body.craters and body.boulders",
            "give the shape's unit (--base-unit), or larger ones (--set body.boulders.smallest=2)",
        )
    if not isinstance(settings, BlindSettings):
        return TruthBody(settings.body)
    base = None if settings.base is None else settings.base.mesh()
    return SolidBody(settings.body, settings.solid, base=base)
