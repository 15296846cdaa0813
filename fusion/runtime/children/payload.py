"""A function sent once to another process, and applied there to one item after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, Self

import cloudpickle

from fusion.runtime.machine.threads import one_blas_thread


@dataclass(frozen=True)
class Payload:
    """A function with all that it refers to, as bytes, and their SHA-256."""

    content: bytes
    digest: str

    @classmethod
    def of(cls, function: Callable[..., Any]) -> Self:
        """Return the payload of a function."""
        content = cloudpickle.dumps(function)
        return cls(content, sha256(content).hexdigest())


# The current function of this process. It is unpacked once: that may open files or build a shape.
_unpacked: dict[str, Callable[[Any], Any]] = {}


def perform(content: bytes, digest: str, item: Any) -> Any:
    """Apply the function of a payload to an item; `content` is not read if it is the last one's."""
    function = _unpacked.get(digest)
    if function is None:
        _unpacked.clear()
        function = _unpacked.setdefault(digest, cloudpickle.loads(content))
    # As on threads: the items are the parallelism, and BLAS must not add its own.
    with one_blas_thread():
        return function(item)
