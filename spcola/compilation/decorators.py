"""Compilation of the numerical kernels: one place for Numba's options.

Kernels release the GIL, so that threads over maplets use every core; they are cached on disk,
so that only the first run of a machine compiles; and they follow NumPy's rules for division by
zero, because NaN marks unknown values.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from spcola.compilation.cache import keep_compiled

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile `function` (serial, no GIL, cached)."""
    return _cached(numba.njit(nogil=True, error_model="numpy")(function), function)


def compiled_inline(function: F) -> F:
    """Compile `function` into each compiled function that calls it.

    For the innermost arithmetic of a loop: a loop with a call in it is not vectorised, and the
    compiler does not inline long functions.
    """
    dispatcher = numba.njit(nogil=True, inline="always", error_model="numpy")(function)
    return cast(F, dispatcher)


def compiled_sums(function: F) -> F:
    """Compile `function` whose sums may be taken in any order, so that they are vectorised.

    Nothing else is relaxed: NaN and infinities propagate.
    """
    relaxed = {"reassoc", "contract", "nsz"}
    dispatcher = numba.njit(nogil=True, error_model="numpy", fastmath=relaxed)(function)
    return _cached(dispatcher, function)


def _cached(dispatcher: Any, function: F) -> F:
    resolve = dispatcher.get_call_template

    def by_type(arguments: Any, keywords: dict[str, Any]) -> Any:
        """Resolve a call in a kernel; Numba would compile once more for a constant argument."""
        named = {key: numba.types.unliteral(kind) for key, kind in keywords.items()}
        return resolve([numba.types.unliteral(kind) for kind in arguments], named)

    dispatcher.get_call_template = by_type
    keep_compiled(dispatcher, function)
    return cast(F, dispatcher)
