"""What the result of a stage depends on, and the record of a result with its digest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from fusion.pipeline.catalog.catalog import Catalog
from fusion.pipeline.catalog.records import StageRecord
from fusion.pipeline.items import whole_version
from fusion.pipeline.stage import Stage, StageResult, find_table
from fusion.runtime import content_digest, json_value
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings


@dataclass(frozen=True)
class StageKey:
    """All that the result of a stage depends on.

    Attributes
    ----------
    digest : str
        Of all that follows, hexadecimal.
    version : str
        Of the program and of the stage.
    settings : mapping
        The tables that the stage declares.
    inputs : mapping of str to str
        The digest of each file that it reads, by its name in the catalogue.
    """

    digest: str
    version: str
    settings: Mapping[str, Any]
    inputs: Mapping[str, str]


def stage_key(stage: Stage, workspace: Workspace, settings: Settings, catalog: Catalog) -> StageKey:
    """Return what the result of `stage` depends on."""
    inputs = catalog.digests(stage.inputs(workspace, settings))
    tables = {
        kind.__name__: find_table(settings, kind).model_dump(mode="json") for kind in stage.tables
    }
    version = whole_version(stage.version)
    return StageKey(_digest(stage.name, version, tables, inputs), version, tables, inputs)


def repeats(record: StageRecord, key: StageKey) -> bool:
    """Return whether a run with this key would differ from that of a record by contents only.

    Then version, settings and the names of inputs are the same.
    """
    if record.key == key.digest:
        return True
    if record.inputs.keys() != key.inputs.keys():
        return False
    return record.key == _digest(record.stage, key.version, key.settings, record.inputs)


def _digest(
    stage: str, version: str, settings: Mapping[str, Any], inputs: Mapping[str, str]
) -> str:
    content = {"stage": stage, "version": version, "settings": settings, "inputs": inputs}
    return content_digest(content)


def current_record(catalog: Catalog, stage: str, key: StageKey) -> StageRecord | None:
    """Return the record of the last run if it is current: same key, outputs unchanged."""
    record = catalog.record(stage)
    if record is None or record.key != key.digest:
        return None
    return record if catalog.recorded(record) == record.outputs else None


def keep_result(
    catalog: Catalog, stage: str, key: StageKey, result: StageResult, *, partly: bool
) -> None:
    """Record the outputs of a stage, and remove those of its last run that this one lacks.

    Parameters
    ----------
    catalog : Catalog
    stage : str
    key : StageKey
    result : StageResult
    partly : bool
        Whether a subset of its items was made: then the outputs that this run lacks are kept, and
        the stage remains due.
    """
    before = catalog.record(stage)
    outputs = catalog.digests(list(result.outputs))
    for path, digest in ({} if before is None else before.outputs).items():
        file = catalog.workspace.path_of(path)
        if path in outputs or not file.is_file():
            continue
        if partly:
            outputs[path] = digest
        # A file that was changed since by hand is not removed.
        elif catalog.digest(file) == digest:
            file.unlink()
    catalog.store(
        StageRecord(
            stage,
            # A key that no run has: the items that were left out are still due.
            f"subset of {key.digest}" if partly else key.digest,
            key.version,
            key.settings,
            key.inputs,
            outputs,
            json_value(result.summary),
            datetime.now(UTC).isoformat(timespec="seconds"),
        )
    )
