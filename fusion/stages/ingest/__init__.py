"""Import of lidar files into the workspace."""

from fusion.stages.ingest.sources import Source, doubles, whole_scans
from fusion.stages.ingest.stage import (
    STAGE,
    Imported,
    Workers,
    import_files,
    scan_facts,
    utc_or_none,
)

__all__ = [
    "STAGE",
    "Imported",
    "Source",
    "Workers",
    "doubles",
    "import_files",
    "scan_facts",
    "utc_or_none",
    "whole_scans",
]
