"""Linear algebra on one thread, so that results are bit-identical on any machine.

A BLAS that distributes a product or a factorisation over threads sums in an order that depends on
their number, and so rounds differently: by 1e-14 of a registration between one core and two. The
cores are used by working on several maplets at once, where the order of sums is fixed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

from threadpoolctl import threadpool_limits


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Keep the BLAS of numpy and scipy to one thread inside; may be nested, and decorate."""
    # The BLAS of scipy is not numpy's, and has to be loaded to be limited. Here and not above, so
    # that commands without linear algebra start fast.
    import_module("scipy.linalg")
    with threadpool_limits(limits=1, user_api="blas"):
        yield
