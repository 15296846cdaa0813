"""Catalogue of artefacts: what they were made from, and whether maplets are sound."""

from fusion.pipeline.catalog.catalog import Catalog
from fusion.pipeline.catalog.digests import FileDigests, file_digest
from fusion.pipeline.catalog.records import SHARED_STAGES, read_record, read_records
from fusion.pipeline.catalog.soundness import unsound

__all__ = [
    "SHARED_STAGES",
    "Catalog",
    "FileDigests",
    "file_digest",
    "read_record",
    "read_records",
    "unsound",
]
