"""Tables of `spcola.toml` on what is read, and where it lies."""

from fusion.workspace.settings.inputs.files import BodySettings, ImportSettings
from fusion.workspace.settings.inputs.geolocation import SpiceSettings, SpinSettings

__all__ = ["BodySettings", "ImportSettings", "SpiceSettings", "SpinSettings"]
