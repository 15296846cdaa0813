"""HDF5 on a disk that is full."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from spcola.formats.hdf5 import new_hdf5, replacing_hdf5


def test_what_is_written_is_read(tmp_path: Path) -> None:
    layers = {str(n): np.random.default_rng(n).normal(size=(1000, n + 1)) for n in range(5)}
    with replacing_hdf5(tmp_path / "a.h5") as file:
        for name, layer in layers.items():
            file.create_dataset(name, data=layer, compression="gzip")
            file.attrs[name] = len(layer)
    with h5py.File(tmp_path / "a.h5", "r") as file:
        for name, layer in layers.items():
            np.testing.assert_array_equal(file[name][:], layer)
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


def test_an_error_of_the_block_is_its_own(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), replacing_hdf5(tmp_path / "a.h5") as file:
        file["x"] = 1 / 0
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), new_hdf5(tmp_path / "none" / "a.h5"):
        pass


PROGRAM = """
import resource, signal, sys
import numpy as np
from spcola.errors import WorkspaceError
from spcola.formats.hdf5 import replacing_hdf5
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
try:
    with replacing_hdf5(sys.argv[1]) as file:
        for n in range(60):
            group = file.create_group(str(n))
            data = np.random.default_rng(n).normal(size=(99, 99))
            group.create_dataset("x", data=data, **eval(sys.argv[2]))
            group.attrs["n"] = n
except WorkspaceError as error:
    print(error)
"""


@pytest.mark.parametrize("how", ["{}", "{'compression': 'gzip', 'chunks': (33, 33)}"])
def test_a_full_disk_is_an_error_and_nothing_else(tmp_path: Path, how: str) -> None:
    before = b"what was there before"
    (tmp_path / "a.h5").write_bytes(before)
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(tmp_path / "a.h5"), how],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "a.h5: cannot be written (File too large)" in done.stdout
    assert (tmp_path / "a.h5").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]
