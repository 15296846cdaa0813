"""Import of lidar files into the workspace."""

from fusion.stages.ingest.lidar_files import (
    LidarFile,
    duplicate_scans,
    readable_scans,
    recorded_origins,
)
from fusion.stages.ingest.stage import STAGE, Imported, import_files, scan_facts, span_facts

__all__ = [
    "STAGE",
    "Imported",
    "LidarFile",
    "duplicate_scans",
    "import_files",
    "readable_scans",
    "recorded_origins",
    "scan_facts",
    "span_facts",
]
