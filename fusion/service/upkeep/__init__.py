"""What an operator sets, what is removed when it is old, and what is made ready in advance."""

from fusion.service.upkeep.cleaning import Cleaner
from fusion.service.upkeep.preparing import Preparer
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
    "Preparer",
    "ServiceSettings",
    "read_settings",
    "settings_text",
]
