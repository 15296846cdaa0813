"""Settings of a workspace: the content of `spcola.toml`."""

from fusion.workspace.settings.settings import Settings, load_settings, problem_text, write_settings
from fusion.workspace.settings.table import Table

__all__ = ["Settings", "Table", "load_settings", "problem_text", "write_settings"]
