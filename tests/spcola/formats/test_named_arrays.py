"""Files of arrays: the same for every reader, on any number of threads."""

from __future__ import annotations

import gc
import sys
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from spcola.formats.named_arrays import read_arrays


@pytest.fixture
def path(tmp_path):
    np.savez(tmp_path / "a.npz", **{f"a{k}": np.full((3, k + 1), k) for k in range(20)})
    return tmp_path / "a.npz"


class Finalized:
    """Garbage in a cycle, whose finalizer gives up the interpreter's lock."""

    def __init__(self):
        self.own = self

    def __del__(self):
        time.sleep(0)


@pytest.fixture
def many_switches():
    """Collections and changes of threads as often as possible."""
    before = gc.get_threshold(), sys.getswitchinterval()
    gc.set_threshold(20)
    sys.setswitchinterval(1e-6)
    yield
    gc.set_threshold(*before[0])
    sys.setswitchinterval(before[1])


def test_threads_that_read_at_once_do_not_disturb_each_other(path, many_switches):
    """CPython 3.11.7 raised SystemError in one of some two hundred reads like these."""

    def read(_):
        for _ in range(3):
            Finalized()
        return sum(int(array[0, 0]) for array in read_arrays(path).values())

    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(read, range(800))) == {190}


def test_a_damaged_file_is_an_error(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises((ValueError, zipfile.BadZipFile)):
        read_arrays(path)
