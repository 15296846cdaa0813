"""The named missions."""

from __future__ import annotations

from collections.abc import Callable

from fusion.truth.blind.settings import blind, blind_full, blind_small
from fusion.truth.presets import MissionSettings

PRESETS: dict[str, Callable[[int], MissionSettings]] = {
    "tiny": MissionSettings.tiny,
    "mini": MissionSettings.mini,
    "pole": MissionSettings.pole,
    "demo": MissionSettings.demo,
    "bennu": MissionSettings.bennu,
    "mission": MissionSettings.mission,
    "blind-small": blind_small,
    "blind": blind,
    "blind-full": blind_full,
}
"""The named missions; each is called with a seed."""
