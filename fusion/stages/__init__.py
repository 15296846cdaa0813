"""The stages of the pipeline, in the order in which data pass through them."""

from fusion.stages.compiling import compiling_ahead
from fusion.stages.loading import load_stages
from fusion.stages.running import import_scans, run_stages

__all__ = ["compiling_ahead", "import_scans", "load_stages", "run_stages"]
