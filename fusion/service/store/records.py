"""Records of the store as values: tokens, entries of the audit log, uploads."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

__all__ = ["ALL_WORKSPACES", "AuditEntry", "Scope", "Token", "Upload", "UploadState"]

ALL_WORKSPACES = "*"


class Scope(StrEnum):
    """What a token permits in a workspace; each permits what the ones before it permit."""

    READ = "read"
    RUN = "run"
    ADMIN = "admin"

    def permits(self, wanted: Scope) -> bool:
        """Return whether this scope covers another one."""
        return _ORDER.index(self) >= _ORDER.index(wanted)


_ORDER = list(Scope)


@dataclass(frozen=True)
class Token:
    """A token without its secret; times are seconds since 1970, UTC.

    Parameters
    ----------
    id : str
    user : str
        In whose name it acts.
    name : str
        For people: what it is for.
    scopes : mapping of str to Scope
        By workspace; those of ``*`` are for all.
    created : float
    expires, revoked, last_used : float
        NaN if never.
    """

    id: str
    user: str
    name: str
    scopes: Mapping[str, Scope]
    created: float
    expires: float = math.nan
    revoked: float = math.nan
    last_used: float = math.nan

    def permits(self, wanted: Scope, workspace: str = ALL_WORKSPACES) -> bool:
        """Return whether the token permits something in a workspace; by default in all."""
        own = [self.scopes[name] for name in (workspace, ALL_WORKSPACES) if name in self.scopes]
        return any(scope.permits(wanted) for scope in own)


@dataclass(frozen=True)
class AuditEntry:
    """Who did what, to what, from where, and what came of it."""

    user: str
    action: str
    workspace: str = ""
    target: str = ""
    outcome: str = ""
    address: str = ""
    details: Mapping[str, Any] = field(default_factory=dict)
    number: int = 0  # given by the store
    time: float = math.nan


class UploadState(StrEnum):
    """Where an upload stands."""

    OPEN = "open"
    COMPLETE = "complete"
    REMOVED = "removed"


@dataclass(frozen=True)
class Upload:
    """A file that is uploaded in parts.

    Parameters
    ----------
    id, workspace, user, name : str
    kind : str
        What it is: scan, image, kernel, spc, shape.
    size : int
        Bytes of the whole file.
    sha256 : str
        Of the whole file, as the client gave it.
    offset : int
        Bytes that have been written.
    state : UploadState
    created, changed : float
    """

    id: str
    workspace: str
    user: str
    name: str
    kind: str
    size: int
    sha256: str
    offset: int = 0
    state: UploadState = UploadState.OPEN
    created: float = math.nan
    changed: float = math.nan
