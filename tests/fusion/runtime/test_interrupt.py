"""Ctrl-C: remembered where a library drops the exception, and only while a command runs."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from fusion.runtime import ThreadExecutor
from fusion.runtime.processes import check_interrupts, remembering_interrupts


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
    check_interrupts()
    with remembering_interrupts():
        check_interrupts()


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
                check_interrupts()
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=command)
    thread.start()
    thread.join()
    assert not failed


def test_an_error_that_a_library_makes_of_an_interrupt_is_one() -> None:
    def broken() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("half a module") from None

    with pytest.raises(KeyboardInterrupt), remembering_interrupts():
        broken()


STARTING = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
class Now:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            signal.raise_signal(signal.SIGINT)
module = sys.argv[1]
if module != "start":
    sys.meta_path.insert(0, Now())
from fusion.cli.start import main
if module == "start":
    signal.raise_signal(signal.SIGINT)
sys.argv = ["spcola", "info", sys.argv[2]]
main()
"""


@pytest.mark.parametrize("module", ["start", "fusion.cli.app", "typer", "numpy", "h5py", "scipy"])
def test_an_interrupt_while_the_program_starts_is_one_line(tmp_path: Path, module: str) -> None:
    """Half of a second of imports: five of fourteen interrupts ended in a traceback."""
    (tmp_path / "a.json").write_text("{}")
    done = subprocess.run(
        [sys.executable, "-c", STARTING, module, str(tmp_path / "a.json")],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).resolve().parents[3],
    )
    assert (done.returncode, done.stdout) == (130, ""), done.stderr
    assert done.stderr.startswith("interrupted: ")
    assert done.stderr.count("\n") == 1
