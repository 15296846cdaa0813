"""Ctrl-C: remembered where a library drops the exception, and only while a command runs."""

from __future__ import annotations

import signal
import threading

import pytest

from fusion.executor import ThreadExecutor
from fusion.interrupt import heed_interrupts, remembering_interrupts


@pytest.fixture(autouse=True)
def _usual_handler() -> None:
    """A job in the background of a shell has interrupts ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


class Finaliser:
    """In its end an interrupt arrives; Python can only print what is raised there."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_that_a_finaliser_swallowed_still_ends_the_work() -> None:
    begun: list[int] = []
    with remembering_interrupts():
        work = ThreadExecutor(1).stream(begun.append, range(1000))
        next(work)
        Finaliser()
        with pytest.raises(KeyboardInterrupt):
            next(work)
    assert len(begun) < 10


def test_an_interrupt_is_raised_where_it_arrives_too() -> None:
    with remembering_interrupts(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_nothing_is_remembered_from_an_earlier_command() -> None:
    with remembering_interrupts(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    heed_interrupts()
    with remembering_interrupts():
        heed_interrupts()


def test_the_handlers_of_others_are_left_alone() -> None:
    for handler in (signal.SIG_IGN, lambda number, frame: None):
        signal.signal(signal.SIGINT, handler)
        with remembering_interrupts():
            assert signal.getsignal(signal.SIGINT) is handler
        assert signal.getsignal(signal.SIGINT) is handler
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_another_thread_may_run_a_command() -> None:
    failed: list[BaseException] = []

    def command() -> None:
        try:
            with remembering_interrupts():
                heed_interrupts()
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=command)
    thread.start()
    thread.join()
    assert not failed
