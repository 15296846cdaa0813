"""Texts without the paths of the machine: users of a service are not shown where it lies."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from itertools import count
from pathlib import Path
from typing import Any

__all__ = ["may_name_paths", "with_texts", "without_paths", "without_paths_in"]

# Folders of an absolute path, wherever in a text it begins; no address on the network.
_FOLDERS = re.compile(r"""(?<![^\s'"`(\[{=,;:<>|])/(?:[^\s/'"`()\[\]{}<>,;:|]+/)+""")
_IN_JSON = re.compile(r"""(?:[\s'"`(\[{=,;:<>|]|\\[nrt])/[^\s/"]+/""")


def without_paths(text: str, folder: Path) -> str:
    """Return a text in which no absolute path is left.

    Files in the folder of the service are named from there on, others by their last part alone.

    Parameters
    ----------
    text : str
    folder : Path
        That of the service, resolved.
    """
    inside = text.replace(f"{folder}/", "").replace(str(folder), folder.name)
    return _FOLDERS.sub("", inside)


def without_paths_in(value: Any, folder: Path) -> Any:
    """Return a value in JSON types whose texts and keys are as of :func:`without_paths`."""
    return with_texts(value, lambda text: without_paths(text, folder))


def may_name_paths(text: str) -> bool:
    """Return whether JSON may contain an absolute path: most does not, and need not be searched."""
    return "/" in text and _IN_JSON.search(text) is not None


def with_texts(value: Any, change: Callable[[str], str]) -> Any:
    """Return a value in JSON types with all texts and keys changed; paths become texts.

    A key that equals another one then gets a number.
    """
    if isinstance(value, Mapping):
        found: dict[str, Any] = {}
        for key, part in value.items():
            found[_new(change(str(key)), found)] = with_texts(part, change)
        return found
    if isinstance(value, list | tuple):
        return [with_texts(part, change) for part in value]
    return change(str(value)) if isinstance(value, str | Path) else value


def _new(name: str, taken: Mapping[str, Any]) -> str:
    """Return a name that is not taken: itself, or with the first free number from 2 on."""
    numbered = (f"{name} ({number})" for number in count(2))
    return name if name not in taken else next(one for one in numbered if one not in taken)
