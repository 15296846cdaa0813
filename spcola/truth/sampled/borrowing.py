"""Arrays without an owner, for the innermost loops of kernels."""

from __future__ import annotations

from typing import Any

from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic  # type: ignore[untyped-decorator]
def borrowed(_context: Any, array: Any) -> Any:
    """Return ``borrowed(array)``, inside a kernel: the array as long as its owner keeps it.

    Numba counts the references to an array with locked instructions, wherever one goes into a
    function that the compiler does not merge with its caller: a score of them for a ray, on
    counters that all threads share. An array that nobody owns is not counted.
    """

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        view = context.make_array(array)(context, builder, arguments[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), generate
