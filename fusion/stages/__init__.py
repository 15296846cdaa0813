"""The stages of the pipeline, and how they are run."""

from fusion.stages.compiling import compiling_ahead
from fusion.stages.run import import_scans, load_stages, run_stages

__all__ = ["compiling_ahead", "import_scans", "load_stages", "run_stages"]
