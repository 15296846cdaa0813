"""Records of the stages: how each last ran, one checksummed JSON file each in ``provenance/``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from fusion.runtime import content_digest, json_value
from fusion.workspace import Workspace
from spcola.errors import WorkspaceError

RECORD_FOLDER = "provenance"
SHARED_STAGES = ("ingest",)
"""Stages whose results all solutions of a workspace share."""
_CHECKSUM = "checksum"


@dataclass(frozen=True)
class StageRecord:
    """How a stage last ran.

    Parameters
    ----------
    stage : str
    key : str
        Digest of version, settings and inputs: equal keys give equal results.
    version : str
        Of the program and of the stage.
    settings : mapping
        The declared tables at that time.
    inputs, outputs : mapping of str to str
        Path (relative to the workspace where inside it) → SHA-256.
    summary : mapping
        What the stage reported.
    finished : str
        UTC, ISO 8601.
    """

    stage: str
    key: str
    version: str
    settings: Mapping[str, Any]
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    summary: Mapping[str, Any]
    finished: str

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self:
        """Rebuild from the content of :meth:`as_dict`.

        Raises
        ------
        ValueError, KeyError, TypeError
            If something is missing, or the content fails its checksum.
        """
        kept = {name: content[name] for name in cls.__dataclass_fields__}
        # Records of earlier versions of the program have no checksum.
        if _CHECKSUM in content and content[_CHECKSUM] != content_digest(kept):
            raise ValueError("fails its checksum")
        return cls(**kept)

    def as_dict(self) -> dict[str, Any]:
        """Return the content in JSON types, with its checksum."""
        content: dict[str, Any] = json_value(asdict(self))
        return {**content, _CHECKSUM: content_digest(content)}


def record_path(workspace: Workspace, stage: str) -> Path:
    """Return where the record of `stage` lies."""
    base = workspace.root if stage in SHARED_STAGES else workspace.home
    return base / RECORD_FOLDER / f"{stage}.json"


def write_record(workspace: Workspace, record: StageRecord) -> None:
    """Write the record of a stage, whole or not at all."""
    workspace.write_json(f"{RECORD_FOLDER}/{record.stage}.json", record.as_dict())


def read_record(workspace: Workspace, stage: str) -> StageRecord | None:
    """Return the record of `stage`; None if there is none, or it is damaged.

    Raises
    ------
    WorkspaceError
        If the file cannot be read.
    """
    path = record_path(workspace, stage)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        record = StageRecord.from_dict(content)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise WorkspaceError(f"cannot be read ({error.strerror})", path) from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return record if record.stage == stage else None


def read_records(workspace: Workspace) -> list[StageRecord]:
    """Return the records in ``provenance/``, with those that solutions share.

    Damaged ones are ignored.

    A stage without a record runs again: a damaged record costs time and never a wrong result.

    Raises
    ------
    WorkspaceError
        If a file cannot be read.
    """
    found = (read_record(workspace, stage) for stage in recorded_stages(workspace))
    return [record for record in found if record is not None]


def recorded_stages(workspace: Workspace) -> list[str]:
    """Return the stages that may have a record: of the solution, and those that solutions share."""
    own = {path.stem for path in (workspace.home / RECORD_FOLDER).glob("*.json")}
    return sorted(own | set(SHARED_STAGES))
