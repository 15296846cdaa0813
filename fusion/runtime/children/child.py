"""The child's side: applies functions to items until its parent is gone."""

from __future__ import annotations

import pickle
import signal
import traceback
from multiprocessing.connection import Connection
from typing import Any

import cloudpickle

from fusion.runtime.children.parent import end_with_parent
from fusion.runtime.children.payload import perform
from fusion.runtime.processes import limit_process
from spcola.errors import SpcolaError

RESULT, ERROR, MEMORY = "result", "error", "memory"


def serve(connection_number: int, parent_number: int, memory_mb: int) -> None:
    """Answer each item that comes over a connection with its result or its error.

    Parameters
    ----------
    connection_number : int
        Descriptor of the connection.
    parent_number : int
        Descriptor of the reading end of a pipe whose writing end only the parent has.
    memory_mb : int
        Limit of the address space; 0 for none.
    """
    # The parent handles Ctrl-C, and ends this process then.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent(parent_number)
    limit_process(memory_mb)
    connection = Connection(connection_number)
    connection.send_bytes(b"ready")
    while True:
        try:
            answer = _answer(*pickle.loads(connection.recv_bytes()))
            connection.send_bytes(answer)
        except (EOFError, OSError):
            return


def _answer(content: bytes, digest: str, item: bytes) -> bytes:
    """Return the pickled outcome of an item, and what came out."""
    try:
        return cloudpickle.dumps((RESULT, perform(content, digest, pickle.loads(item))))
    except MemoryError as error:
        return pickle.dumps((MEMORY, str(error)))
    except Exception as error:
        return pickle.dumps((ERROR, _sendable(error)))


def _sendable(error: Exception) -> Exception:
    """Return an error that can be pickled, with its trace if it is unexpected."""
    if not isinstance(error, SpcolaError):
        trace: Any = "".join(traceback.format_exception(error))
        error.add_note(f"In a child process:\n{trace}")
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
