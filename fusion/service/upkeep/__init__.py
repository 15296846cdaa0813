"""What an operator sets, and what is removed when it is old."""

from fusion.service.upkeep.cleaning import Cleaner
from fusion.service.upkeep.settings import (
    SETTINGS_NAME,
    Ages,
    ServiceSettings,
    read_settings,
    settings_text,
)

__all__ = [
    "SETTINGS_NAME",
    "Ages",
    "Cleaner",
    "ServiceSettings",
    "read_settings",
    "settings_text",
]
