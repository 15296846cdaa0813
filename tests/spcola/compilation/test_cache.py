"""Kernels work where nothing can be written: in containers, without a home, on a full disk."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import spcola

PROBE = """
from spcola.compilation.decorators import compiled, compiled_sums

@compiled
def add(a, b):
    return a + b

@compiled_sums
def twice(a):
    return 2.0 * a

print(add(1.0, 2.0), twice(2.0))
"""
KERNELS = f"spcola-kernels-{os.getuid()}"


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """A module of kernels whose folder of compiled code cannot be made, whoever runs it."""
    folder = tmp_path / "program"
    folder.mkdir()
    (folder / "probe.py").write_text(PROBE)
    (folder / "__pycache__").write_text("")
    (tmp_path / "tmp").mkdir()
    return folder


def run(
    program: Path, *, full: bool = False, home: str = "/dev/null/home"
) -> subprocess.CompletedProcess[str]:
    def confine() -> None:
        if full:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))

    return subprocess.run(
        [sys.executable, "-c", "import probe"],
        cwd=program,
        env={
            "PATH": os.environ["PATH"],
            "PYTHONPATH": f"{program}:{Path(spcola.__file__).parents[1]}",
            "HOME": home,
            "TMPDIR": str(program.parent / "tmp"),
        },
        capture_output=True,
        text=True,
        preexec_fn=confine,
        timeout=120,
        check=False,
    )


def test_a_private_temporary_folder_takes_the_place_of_the_others(program: Path) -> None:
    kept = program.parent / "tmp" / KERNELS
    for _ in range(2):
        ran = run(program)
        assert (ran.returncode, ran.stdout) == (0, "3.0 4.0\n")
        assert ran.stderr.splitlines() == [
            f"note: {kept} keeps compiled kernels: program and home folder cannot be written"
        ]
    assert kept.stat().st_mode & 0o777 == 0o700
    assert len(list(kept.rglob("*.nbc"))) == 2


def test_where_the_home_can_be_written_nothing_is_said(program: Path, tmp_path: Path) -> None:
    ran = run(program, home=str(tmp_path))
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "3.0 4.0\n", "")


def _open_to_all(place: Path) -> None:
    place.mkdir()
    place.chmod(0o777)


def _a_link(place: Path) -> None:
    (place.parent / "elsewhere").mkdir(mode=0o700)
    place.symlink_to(place.parent / "elsewhere")


@pytest.mark.parametrize("spoil", [_open_to_all, _a_link])
def test_a_folder_that_another_could_write_to_is_not_taken(
    program: Path, spoil: Callable[[Path], None]
) -> None:
    spoil(program.parent / "tmp" / KERNELS)
    ran = run(program)
    assert (ran.returncode, ran.stdout) == (0, "3.0 4.0\n")
    assert len(ran.stderr.splitlines()) == 1
    assert "every process compiles them; set NUMBA_CACHE_DIR" in ran.stderr
    assert not list(program.parent.rglob("*.nbc"))


def test_a_full_disk_costs_the_cache_and_nothing_else(program: Path) -> None:
    """Files can be made, but nothing written into them."""
    ran = run(program, full=True, home=str(program.parent))
    assert (ran.returncode, ran.stdout) == (0, "3.0 4.0\n")
    assert len(ran.stderr.splitlines()) == 1
    assert "(File too large): every process compiles them; set NUMBA_CACHE_DIR" in ran.stderr
    # What is left must not lead the next process to code of another source.
    assert not list(program.parent.rglob("*.nb?"))


def test_kept_code_that_is_damaged_is_compiled_again(program: Path) -> None:
    run(program)
    files = list((program.parent / "tmp" / KERNELS).rglob("*.nb?"))
    assert len(files) == 4
    for number, file in enumerate(sorted(files)):
        file.write_bytes(b"" if number % 2 else file.read_bytes()[:-20])
    again = run(program)
    assert (again.returncode, again.stdout) == (0, "3.0 4.0\n"), again.stderr


def test_code_of_other_types_is_not_taken_for_what_is_asked(program: Path) -> None:
    """Two processes that keep two forms of a kernel at one moment may name one file for both."""
    (program / "probe.py").write_text(PROBE.replace("twice(2.0))", "add(1, 2))"))
    assert run(program).stdout == "3.0 3\n"
    kept = sorted((program.parent / "tmp" / KERNELS).rglob("*.nbc"))
    assert len(kept) == 2
    kept[1].write_bytes(kept[0].read_bytes())
    again = run(program)
    assert (again.returncode, again.stdout) == (0, "3.0 3\n"), again.stderr
