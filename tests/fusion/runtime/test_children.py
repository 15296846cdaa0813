"""Items in child processes: the death of a child costs a try of its item, and nothing else."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fusion.runtime import ThreadExecutor
from fusion.runtime.children import PoisonousItemError, ProcessExecutor
from fusion.runtime.processes import ProcessLimits
from spcola.errors import SpcolaError, WorkspaceError

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def executor() -> Iterator[ProcessExecutor]:
    with ProcessExecutor(2) as made:
        yield made


def test_results_are_those_of_threads_to_the_bit_and_in_order(executor: ProcessExecutor) -> None:
    shapes = np.random.default_rng(1).normal(size=(12, 40, 40))

    def solved(item: int) -> np.ndarray:
        return np.linalg.inv(shapes[item]) @ shapes[item - 1]

    one = list(ThreadExecutor(2).stream(solved, range(12)))
    other = list(executor.stream(solved, range(12)))
    for first, second in zip(one, other, strict=True):
        np.testing.assert_array_equal(first, second)
    workers = list(executor.stream(lambda _: time.sleep(0.02) or os.getpid(), range(8)))
    assert len(set(workers)) == 2
    assert os.getpid() not in workers
    # They serve the next function too.
    assert set(executor.stream(lambda _: os.getpid(), range(4))) <= set(workers)


def test_items_are_read_only_as_children_become_free(executor: ProcessExecutor) -> None:
    read: list[int] = []
    stream = executor.stream(abs, (read.append(item) or item for item in range(100)))
    assert next(stream) == 0
    assert len(read) <= 4
    stream.close()


def test_an_error_of_a_child_is_that_of_the_caller(executor: ProcessExecutor) -> None:
    def fail(item: int) -> int:
        raise WorkspaceError("is not there", "/data/scan", "restore it") if item else KeyError(item)

    with pytest.raises(WorkspaceError, match="/data/scan: is not there; restore it") as raised:
        list(executor.stream(fail, [1]))
    assert raised.value.do == "restore it"
    with pytest.raises(KeyError) as unexpected:
        list(executor.stream(fail, [0]))
    assert "in fail" in unexpected.value.__notes__[0]


def test_a_death_repeats_its_item_alone(executor: ProcessExecutor, tmp_path: Path) -> None:
    def once(item: int) -> int:
        done = tmp_path / f"{item}.{len(list(tmp_path.glob(f'{item}.*')))}"
        done.touch()
        if item == 3 and done.suffix == ".0":
            os.kill(os.getpid(), signal.SIGKILL)
        return item * item

    assert list(executor.stream(once, range(8))) == [item * item for item in range(8)]
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "0.0", "1.0", "2.0", "3.0", "3.1", "4.0", "5.0", "6.0", "7.0",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("what", "how"),
    [
        ("import ctypes; ctypes.string_at(0)", r"signal 11 \(SIGSEGV\)"),
        ("bytearray(3 << 30)", r"out of memory \(limit 2048 MB\)"),
        ("import time; time.sleep(60)", "it took more than 1 s"),
        ("import os; os._exit(3)", "it ended with exit code 3"),
    ],
)
def test_an_item_that_ends_all_its_children_is_named(what: str, how: str) -> None:
    def run(item: tuple[Path, str]) -> int:
        exec(what if item[0].stem == "bad" else "")
        return 1

    items = [(Path(f"/data/{name}.las"), "") for name in ("good", "bad", "better")]
    with ProcessExecutor(1, limits=ProcessLimits(2048, 1.0), tries=2) as limited:
        with pytest.raises(PoisonousItemError, match=rf"bad.las: .* 2 times: {how}") as raised:
            list(limited.stream(run, items))
        assert (raised.value.code, raised.value.item) == ("poisonous-item", "bad.las")
        assert list(limited.stream(run, items[::2])) == [1, 1]


def test_a_closed_executor_has_no_children() -> None:
    with ProcessExecutor(2) as made:
        children = set(made.stream(lambda _: time.sleep(0.02) or os.getpid(), range(4)))
    assert not any(Path(f"/proc/{child}").exists() for child in children)
    with pytest.raises(SpcolaError, match="were ended"):
        list(made.stream(abs, [1]))


PROGRAM = """
import os, signal, sys, time
# A job in the background of a shell has interrupts ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
from fusion.runtime.children import ProcessExecutor
def run(item):
    # In one piece: the other child writes to the same pipe.
    os.write(2, b"%d\\n" % os.getpid())
    # An interpreter's lock that is never given up.
    return 10 ** (10 ** 8) if item else 0
with ProcessExecutor(2) as executor:
    list(executor.stream(run, [int(sys.argv[1])] * 2))
    time.sleep(60)
"""


@pytest.mark.parametrize(
    ("how", "item"), [(signal.SIGINT, 0), (signal.SIGTERM, 1), (signal.SIGKILL, 1)]
)
def test_no_child_outlives_its_parent(how: signal.Signals, item: int) -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(item)],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert parent.stderr is not None
    children = [int(parent.stderr.readline()) for _ in range(2)]
    parent.send_signal(how)
    parent.wait(20)
    until = time.monotonic() + 10
    while any(map(_runs, children)) and time.monotonic() < until:
        time.sleep(0.02)
    parent.stderr.close()
    assert not any(map(_runs, children))


def _runs(process: int) -> bool:
    """Return whether a process runs; one that ended may still wait for its parent's parent."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
