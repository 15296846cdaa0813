"""What can be wrong with a request to the store, or with the store itself."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path

from spcola.errors import SpcolaError


class StoreFault(StrEnum):
    """Code of a :class:`StoreError`."""

    UNKNOWN_JOB = "unknown-job"
    LEASE_LOST = "lease-lost"
    KEY_REUSED = "key-reused"  # an idempotency key with another request
    UNKNOWN_TOKEN = "unknown-token"  # no token has this id
    REFUSED_TOKEN = "refused-token"  # a secret that is unknown, expired or revoked
    UNKNOWN_UPLOAD = "unknown-upload"
    WRONG_OFFSET = "wrong-offset"  # a part of an upload does not begin where the last one ended
    NEWER_STORE = "newer-store"  # written by a later version of the program
    OLDER_STORE = "older-store"  # cannot be upgraded without a folder for its backup
    DAMAGED = "damaged-store"
    DISK_FULL = "disk-full"
    BUSY = "store-busy"
    UNAVAILABLE = "store-unavailable"  # no connection, no permission, a disk that fails


class StoreError(SpcolaError):
    """The store refuses a request, or cannot serve it; `code` is for programs."""

    def __init__(
        self,
        code: StoreFault,
        what: str,
        where: str | Path | None = None,
        do: str | None = None,
    ) -> None:
        self.code = code
        super().__init__(what, where, do)


class UnknownJobError(StoreError):
    """No job has this id."""

    def __init__(self, identity: str) -> None:
        super().__init__(StoreFault.UNKNOWN_JOB, "there is no such job", f"job {identity[:60]!r}")


class LeaseLostError(StoreError):
    """A job no longer belongs to the worker: what the worker has done of it is not recorded."""

    def __init__(self, identity: str, worker: str) -> None:
        what = f"no longer belongs to the worker {worker!r}"
        super().__init__(StoreFault.LEASE_LOST, what, f"job {identity[:60]!r}")
