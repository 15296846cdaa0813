"""Runs the stages in order and skips those that are up to date."""

from fusion.pipeline.opened import opened
from fusion.pipeline.pipeline import Pipeline
from fusion.pipeline.stage import Stage, StageContext, StageResult, find_table
from fusion.pipeline.stage_run import StageRun
from fusion.pipeline.subset import Subset, with_kept

__all__ = [
    "Pipeline",
    "Stage",
    "StageContext",
    "StageResult",
    "StageRun",
    "Subset",
    "find_table",
    "opened",
    "with_kept",
]
