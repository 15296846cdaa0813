"""JSON objects in the files of a workspace."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from spcola.errors import WorkspaceError


def read_object(path: Path, do: str = "remove it and run again") -> dict[str, Any]:
    """Read a JSON object; null becomes None.

    Parameters
    ----------
    path : Path
    do : str
        What to do if it is damaged.

    Raises
    ------
    WorkspaceError
        If it cannot be read or holds no JSON object.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise WorkspaceError(f"cannot be read ({error.strerror})", path) from error
    except (ValueError, RecursionError) as error:
        raise WorkspaceError(f"is not JSON ({error})", path, do) from error
    if not isinstance(content, dict):
        raise WorkspaceError("holds no JSON object", path, do)
    return content
