"""Arrays without reference counting, for the innermost loops of kernels."""

from __future__ import annotations

from typing import Any

from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic  # type: ignore[untyped-decorator]
def uncounted(_context: Any, array: Any) -> Any:
    """Return ``uncounted(array)``, inside a kernel: the array, valid as long as its owner keeps it.

    Numba counts the references to an array with atomic instructions, wherever one is passed to a
    function that the compiler does not inline: some twenty times for a ray, on counters shared by
    all threads. This one is not counted.
    """

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        view = context.make_array(array)(context, builder, arguments[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), generate
