"""What the service keeps on disk: jobs, tokens, audit log, uploads; SQLite or PostgreSQL."""

from fusion.service.store.errors import LeaseLostError, StoreError, StoreFault, UnknownJobError
from fusion.service.store.records import AuditEntry, Scope, Token, Upload
from fusion.service.store.store import Store

__all__ = [
    "AuditEntry",
    "LeaseLostError",
    "Scope",
    "Store",
    "StoreError",
    "StoreFault",
    "Token",
    "UnknownJobError",
    "Upload",
]
