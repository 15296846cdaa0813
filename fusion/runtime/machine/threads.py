"""Linear algebra on one thread, so that results are the same to the bit on any machine.

A BLAS that shares a product or a factorisation out among threads sums in another order, and so
rounds otherwise, for each number of them: by 1e-14 of a registration, one core or two. The cores
are used by working on several maplets at once, where the order of sums is fixed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import scipy.linalg  # noqa: F401 (its BLAS is not numpy's, and has to be loaded to be limited)
from threadpoolctl import threadpool_limits


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Keep the BLAS of numpy and scipy to one thread inside; may be nested, and decorate."""
    with threadpool_limits(limits=1, user_api="blas"):
        yield
