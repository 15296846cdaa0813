"""Kernels that a second process compiles: it is started when they are missing, and ended."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from fusion.stages import compiling, compiling_ahead
from fusion.stages.compiling import compile_late
from fusion.surfacematch import MATCH_KERNEL
from spcola.compilation import KernelCache, is_kept
from spcola.heights import HeightSystem
from spcola.heights.smoothing import multiply


def test_made_up_surfaces_need_the_kernels_of_the_late_stages() -> None:
    compile_late()
    assert is_kept(MATCH_KERNEL) == is_kept(multiply) == KernelCache.usable
    # Both precisions of the heights' cycle: the late stages need both.
    precisions = {signature[1].dtype.name for signature in multiply.signatures}
    assert precisions == {"float32", "float64"}


@pytest.mark.parametrize("kept", [True, False])
def test_a_process_compiles_what_is_not_kept_and_no_longer_than_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: bool
) -> None:
    note = tmp_path / "pid"
    monkeypatch.setattr(
        compiling, "_COMMAND",
        f"import os, time; open({str(note)!r}, 'w').write(str(os.getpid())); time.sleep(60)",
    )  # fmt: skip
    monkeypatch.setattr(compiling, "is_kept", lambda _: kept)
    monkeypatch.setattr(HeightSystem, "is_compiled", lambda: kept)
    monkeypatch.setattr(KernelCache, "usable", True)
    with compiling_ahead():
        while not kept and not (note.exists() and note.read_text()):
            time.sleep(0.02)
    assert note.exists() == (not kept)
    if not kept:
        with pytest.raises(ProcessLookupError):
            os.kill(int(note.read_text()), 0)
