"""The executor: order, bounded look-ahead, cancelling."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator

import pytest

from fusion.runtime import ThreadExecutor
from spcola.errors import SettingsError


def test_results_keep_the_order_of_the_items() -> None:
    def slow_first(item: int) -> int:
        time.sleep(0.02 if item == 0 else 0.0)
        return item * item

    assert list(ThreadExecutor(4).stream(slow_first, range(20))) == [n * n for n in range(20)]


def test_the_interpreter_is_handed_over_as_before_when_the_work_is_done() -> None:
    usual = sys.getswitchinterval()
    during = list(ThreadExecutor(2).stream(lambda _: sys.getswitchinterval(), range(2)))
    assert max(during) < usual
    assert sys.getswitchinterval() == usual
    with pytest.raises(ZeroDivisionError):
        list(ThreadExecutor(2).stream(lambda n: 1 / n, [0]))
    assert sys.getswitchinterval() == usual


def test_no_items_give_no_results() -> None:
    assert list(ThreadExecutor(2).stream(abs, [])) == []


def test_work_runs_on_several_threads_at_once() -> None:
    meeting = threading.Barrier(3, timeout=10)
    list(ThreadExecutor(3).stream(lambda _: meeting.wait(), range(3)))


def test_items_are_read_only_as_workers_become_free() -> None:
    read = 0

    def items() -> Iterator[int]:
        nonlocal read
        for item in range(1000):
            read += 1
            yield item

    stream = ThreadExecutor(2).stream(abs, items())
    assert next(stream) == 0
    assert read <= 4
    stream.close()


def test_the_first_error_cancels_what_has_not_begun() -> None:
    begun: list[int] = []

    def fail_early(item: int) -> int:
        begun.append(item)
        if item == 1:
            raise ValueError("item 1")
        time.sleep(0.01)
        return item

    with pytest.raises(ValueError, match="item 1"):
        list(ThreadExecutor(2).stream(fail_early, range(1000)))
    assert len(begun) < 20
    assert not any(thread.name.startswith("spcola") for thread in threading.enumerate())


def test_an_interrupt_in_the_caller_ends_the_workers() -> None:
    def items() -> Iterator[int]:
        yield from range(3)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(ThreadExecutor(2).stream(abs, items()))
    assert not any(thread.name.startswith("spcola") for thread in threading.enumerate())


def test_at_least_one_worker_is_needed() -> None:
    with pytest.raises(SettingsError, match="workers"):
        ThreadExecutor(0)


def test_by_default_there_is_a_worker() -> None:
    assert ThreadExecutor().workers >= 1


@pytest.mark.parametrize("workers", [-1, 0, 1025, 2**63])
def test_an_absurd_number_of_workers_is_refused(workers: int) -> None:
    with pytest.raises(SettingsError, match=f"must be 1 to 1024, not {workers}"):
        ThreadExecutor(workers)
