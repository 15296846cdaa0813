"""Tables of `spcola.toml` for the stages after the import."""

from fusion.workspace.settings.processing.fits import (
    AcceptSettings,
    RegisterSettings,
    ScaleSettings,
)
from fusion.workspace.settings.processing.surfaces import (
    BigmapSettings,
    BigmapSite,
    FuseSettings,
    LithosSettings,
    MapolaSettings,
    ReleaseSettings,
)

__all__ = [
    "AcceptSettings",
    "BigmapSettings",
    "BigmapSite",
    "FuseSettings",
    "LithosSettings",
    "MapolaSettings",
    "RegisterSettings",
    "ReleaseSettings",
    "ScaleSettings",
]
