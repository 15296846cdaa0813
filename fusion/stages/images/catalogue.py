"""The catalogue of the images of a workspace: ``images.jsonl``, a line of JSON for each.

Lines are in the order of the names, so that the file does not depend on the order of imports. It is
counted without being parsed.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from fusion.runtime import json_value
from fusion.stages.images.record import ImageRecord
from fusion.workspace import Workspace
from spcola import atomic
from spcola.errors import FormatError, WorkspaceError

CATALOGUE = "images.jsonl"


def catalogue_path(workspace: Workspace) -> Path:
    """Return where the catalogue lies: pixels belong to the workspace, not to one solution."""
    return workspace.root / CATALOGUE


def read_catalogue(workspace: Workspace) -> dict[str, ImageRecord]:
    """Return the records of all images by name; none without a catalogue.

    Raises
    ------
    FormatError
        If a line is no record.
    WorkspaceError
        If the file cannot be read.
    """
    path = catalogue_path(workspace)
    if not path.is_file():
        return {}
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise WorkspaceError(f"cannot be read ({error})", path) from error
    found = {}
    for number, line in enumerate(lines, start=1):
        where = f"{path}, line {number}"
        try:
            content = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise FormatError(f"is not JSON ({error})", where, "import the images again") from error
        record = ImageRecord.from_json(content, where)
        found[record.name] = record
    return found


def count_images(workspace: Workspace) -> int:
    """Return the number of images in the catalogue."""
    path = catalogue_path(workspace)
    if not path.is_file():
        return 0
    with path.open("rb") as stream:
        return sum(part.count(b"\n") for part in iter(lambda: stream.read(1 << 20), b""))


def write_catalogue(workspace: Workspace, records: Iterable[ImageRecord]) -> None:
    """Write the catalogue whole or not at all.

    Raises
    ------
    WorkspaceError
        If it cannot be written.
    """
    ordered = sorted(records, key=lambda record: record.name)
    lines = [
        json.dumps(
            json_value(record.as_json()), sort_keys=True, ensure_ascii=False, allow_nan=False
        )
        for record in ordered
    ]
    text = "".join(f"{line}\n" for line in lines)
    atomic.write_text(catalogue_path(workspace), text.encode("utf-8", "replace").decode("utf-8"))
