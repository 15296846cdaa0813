"""The tables of `spcola.toml`."""

from fusion.workspace.settings.settings import Settings, complaint, load_settings, write_settings
from fusion.workspace.settings.tables import (
    AcceptSettings,
    BigmapSettings,
    BigmapSite,
    BodySettings,
    FuseSettings,
    ImportSettings,
    MapolaSettings,
    RegisterSettings,
    ReleaseSettings,
    ScaleSettings,
    SpiceSettings,
    SpinSettings,
    Table,
)

__all__ = [
    "AcceptSettings",
    "BigmapSettings",
    "BigmapSite",
    "BodySettings",
    "FuseSettings",
    "ImportSettings",
    "MapolaSettings",
    "RegisterSettings",
    "ReleaseSettings",
    "ScaleSettings",
    "Settings",
    "SpiceSettings",
    "SpinSettings",
    "Table",
    "complaint",
    "load_settings",
    "write_settings",
]
