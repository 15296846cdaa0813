"""The stages of the pipeline, how they are run, and where their returns lie."""

from fusion.stages.compiling import compiling_ahead
from fusion.stages.loading import load_stages
from fusion.stages.running import import_scans, run_stages

__all__ = ["compiling_ahead", "import_scans", "load_stages", "run_stages"]
