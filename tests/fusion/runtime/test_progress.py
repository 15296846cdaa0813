"""Progress: silent, plain lines, a bar; nothing about short work."""

from __future__ import annotations

import io

import pytest

import fusion.runtime.progress
from fusion.runtime import Progress


def test_short_work_prints_nothing() -> None:
    stream = io.StringIO()
    with Progress("lines", stream).task("grid", 3) as task:
        for _ in range(3):
            task.advance()
    assert stream.getvalue() == ""


def test_long_work_prints_its_progress_in_plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(0, 10_000, 4))
    monkeypatch.setattr("fusion.runtime.progress.time.monotonic", lambda: float(next(clock)))
    stream = io.StringIO()
    with Progress("lines", stream).task("grid", 2) as task:
        task.advance()
        task.advance()
    lines = stream.getvalue().splitlines()
    assert lines[0].startswith("grid: 1 of 2")
    assert lines[-1].startswith("grid: 2 of 2 done in")
    assert "\x1b" not in stream.getvalue()


def test_silence_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fusion.runtime.progress, "PATIENCE_S", 0.0)
    stream = io.StringIO()
    progress = Progress("silent", stream)
    progress.note("a note")
    with progress.task("grid", 1) as task:
        task.advance()
    assert stream.getvalue() == ""


def test_a_bar_appears_on_long_work_and_goes_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fusion.runtime.progress, "PATIENCE_S", 0.0)
    stream = io.StringIO()
    with Progress("bar", stream).task("grid", 2) as task:
        task.advance(2)
    assert "grid: 2 of 2 done" in stream.getvalue()


def test_failed_work_is_not_reported_as_done(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fusion.runtime.progress, "PATIENCE_S", 0.0)
    stream = io.StringIO()
    for mode in ("bar", "lines"):
        with pytest.raises(ValueError, match="stop"), Progress(mode, stream).task("grid", 2):
            raise ValueError("stop")
    assert "done" not in stream.getvalue()


def test_notes_keep_brackets() -> None:
    stream = io.StringIO()
    Progress("lines", stream).note("see [mapolas] gsd_m")
    assert stream.getvalue() == "see [mapolas] gsd_m\n"


def test_json_output_asks_for_silence() -> None:
    assert Progress.fitting(silent=True).mode == "silent"
