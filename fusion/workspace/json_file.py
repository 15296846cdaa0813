"""JSON objects in the files of a workspace."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from spcola.errors import WorkspaceError

__all__ = ["read_object"]
_AGAIN = "remove it and run again"


def read_object(path: Path, do: str = "") -> dict[str, Any]:
    """Read a JSON object; null becomes None.

    Parameters
    ----------
    path : Path
    do : str
        What to do if it is damaged; by default to remove it and run again.

    Raises
    ------
    WorkspaceError
        If it cannot be read or holds no JSON object.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise WorkspaceError(f"cannot be read ({error.strerror})", path, do or None) from error
    except (ValueError, RecursionError) as error:
        raise WorkspaceError(f"is not JSON ({error})", path, do or _AGAIN) from error
    if not isinstance(content, dict):
        raise WorkspaceError("holds no JSON object", path, do or _AGAIN)
    return content
