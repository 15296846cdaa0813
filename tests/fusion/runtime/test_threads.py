"""Results are the same to the bit, however many threads the linear algebra could take."""

from __future__ import annotations

import numpy as np
from threadpoolctl import threadpool_limits

from fusion.runtime.machine import one_blas_thread


def solved() -> bytes:
    """Bytes of products and factorisations large enough for a BLAS to share them out."""
    made = np.random.default_rng(1).normal(size=(300, 300))
    square = made @ made.T + 300.0 * np.eye(300)
    return b"".join(
        part.tobytes()
        for part in (square, np.linalg.inv(square), *np.linalg.eigh(square), made[:5] @ made)
    )


def test_the_bits_do_not_depend_on_the_threads_that_there_are() -> None:
    found = []
    for threads in (1, 2):
        with threadpool_limits(limits=threads, user_api="blas"), one_blas_thread():
            found.append(solved())
    assert found[0] == found[1]


def test_it_may_be_nested_and_gives_back_what_there_was() -> None:
    @one_blas_thread()
    def inner() -> bytes:
        return solved()

    with one_blas_thread():
        assert inner() == inner()
        assert inner() == solved()
