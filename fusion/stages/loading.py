"""Stages by name, in the order in which data pass through them."""

from __future__ import annotations

from importlib import import_module

from fusion.pipeline import Stage

ORDER = ("ingest", "mapolas", "register", "fuse", "bigmap", "scale", "release", "report")


def load_stage(name: str) -> Stage:
    """Return the stage `name`; its module is imported only now."""
    stage: Stage = import_module(f"fusion.stages.{name}").STAGE
    return stage


def load_stages() -> list[Stage]:
    """Return all stages in their order."""
    return [load_stage(name) for name in ORDER]
