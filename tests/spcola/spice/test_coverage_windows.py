"""Coverage of positions and attitudes by kernels: spans, gaps between states, precedence."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import spiceypy

from spcola.errors import KernelError
from spcola.navigation import SPICE_LOCK
from spcola.spice import KernelCoverage, KernelSet, body_fixed_states, coverage
from spcola.spice.coverage_windows import QuantityCoverage, Segment

CRAFT, BENNU, FRAME = -999, 2101955, "CRAFT_BUS"
# Images in two bursts a minute apart, one image alone, and hours between them.
TIMES = np.concatenate([60.0 * np.arange(10), [20_000.0], 40_000.0 + 60.0 * np.arange(10)])
PCK = """KPL/PCK
\\begindata
  BODY2101955_POLE_RA = 85.0
  BODY2101955_POLE_DEC = -60.0
  BODY2101955_PM = ( 10.0 2011.0 )
\\begintext
"""
# A clock of 1000 ticks a second that began at J2000.
CLOCK = """KPL/SCLK
\\begindata
SCLK_KERNEL_ID = ( @2020-01-01/00:00 )
SCLK_DATA_TYPE_999 = ( 1 )
SCLK01_TIME_SYSTEM_999 = ( 1 )
SCLK01_N_FIELDS_999 = ( 2 )
SCLK01_MODULI_999 = ( 100000000 1000 )
SCLK01_OFFSETS_999 = ( 0 0 )
SCLK01_OUTPUT_DELIM_999 = ( 1 )
SCLK_PARTITION_START_999 = ( 0.0 )
SCLK_PARTITION_END_999 = ( 1.0E+11 )
SCLK01_COEFFICIENTS_999 = ( 0.0 0.0 1.0 )
\\begintext
"""
FRAMES = """KPL/FK
\\begindata
FRAME_CRAFT_BUS = -999000
FRAME_-999000_NAME = 'CRAFT_BUS'
FRAME_-999000_CLASS = 3
FRAME_-999000_CLASS_ID = -999000
FRAME_-999000_CENTER = -999
CK_-999000_SCLK = -999
CK_-999000_SPK = -999
FRAME_CRAFT_LIDAR = -999001
FRAME_-999001_NAME = 'CRAFT_LIDAR'
FRAME_-999001_CLASS = 4
FRAME_-999001_CLASS_ID = -999001
FRAME_-999001_CENTER = -999
TKFRAME_-999001_RELATIVE = 'CRAFT_BUS'
TKFRAME_-999001_SPEC = 'ANGLES'
TKFRAME_-999001_UNITS = 'DEGREES'
TKFRAME_-999001_ANGLES = ( 0.0 0.0 90.0 )
TKFRAME_-999001_AXES = ( 1 2 3 )
\\begintext
"""
RATE = 1e-4


def texts(folder: Path) -> list[Path]:
    paths = []
    for name, text in (("a.tpc", PCK), ("a.tsc", CLOCK), ("a.tf", FRAMES)):
        paths.append(folder / name)
        paths[-1].write_text(text)
    return paths


def states(times: np.ndarray) -> np.ndarray:
    """A spacecraft that drifts by a metre a second, km."""
    rows = np.zeros((len(times), 6))
    rows[:, 0], rows[:, 1], rows[:, 4] = 3.0, 1e-3 * times, 1e-3
    return rows


def spk(path: Path, kind: int, times: np.ndarray = TIMES) -> Path:
    """An SPK of a type, from states at some times, or over their span."""
    head = (CRAFT, BENNU, "J2000", times[0], times[-1], "S")
    rows = states(times)
    with SPICE_LOCK:
        handle = spiceypy.spkopn(str(path), "TEST", 0)
        if kind == 5:
            spiceypy.spkw05(handle, *head, 1e-9, len(times), rows, times)
        elif kind in {9, 13}:
            write = spiceypy.spkw09 if kind == 9 else spiceypy.spkw13
            write(handle, *head, 3 if kind == 13 else 1, len(times), rows, times)
        elif kind in {8, 12}:
            write = spiceypy.spkw08 if kind == 8 else spiceypy.spkw12
            step = float(times[1] - times[0])
            write(handle, *head, 3 if kind == 12 else 1, len(times), rows, times[0], step)
        elif kind == 18:
            spiceypy.spkw18(handle, 1, *head, 3, rows, times)
        else:
            span = float(times[-1] - times[0])
            spiceypy.spkw02(handle, *head, span, 1, 1, np.ones(6), times[0])
        spiceypy.spkcls(handle)
    return path


def ck(path: Path, times: np.ndarray = TIMES, starts: np.ndarray | None = None) -> Path:
    """A CK of attitudes that turn about Z at `RATE`, in one interval if none is given."""
    ticks = 1000.0 * times
    half = RATE * times / 2.0
    quats = np.column_stack([np.cos(half), 0 * half, 0 * half, -np.sin(half)])
    begins = ticks[:1] if starts is None else 1000.0 * starts
    with SPICE_LOCK:
        handle = spiceypy.ckopn(str(path), "TEST", 0)
        spiceypy.ckw03(
            handle, ticks[0], ticks[-1], -999000, "J2000", False, "S", len(ticks), ticks, quats,
            np.zeros((len(ticks), 3)), len(begins), begins,
        )  # fmt: skip
        spiceypy.ckcls(handle)
    return path


def windows(kernels: list[Path], **options: object) -> np.ndarray:
    with KernelSet(kernels).load():
        return coverage(CRAFT, **options).windows()  # type: ignore[arg-type]


BURSTS = np.array([[0.0, 540.0], [20_000.0, 20_000.0], [40_000.0, 40_540.0]])


@pytest.mark.parametrize("kind", [5, 9, 13, 18])
def test_states_at_listed_epochs_leave_gaps(tmp_path: Path, kind: int) -> None:
    path = spk(tmp_path / "a.bsp", kind)
    found = windows([path, *texts(tmp_path)], max_gap_s=600.0)
    np.testing.assert_allclose(found, BURSTS)
    whole = windows([path, *texts(tmp_path)])
    np.testing.assert_allclose(whole, [[0.0, 40_540.0]])
    with KernelSet([path, *texts(tmp_path)]).load():
        known = coverage(CRAFT, max_gap_s=600.0)
    wanted = [-1.0, 0.0, 30.0, 541.0, 19_999.0, 20_000.0, 20_001.0, 40_540.0, 40_541.0]
    right = [False, True, True, False, False, True, False, True, False]
    np.testing.assert_array_equal(known.covers(wanted), right)


@pytest.mark.parametrize("kind", [8, 12])
def test_states_at_even_steps_are_gaps_where_steps_are_long(tmp_path: Path, kind: int) -> None:
    times = 3600.0 * np.arange(6)
    path = spk(tmp_path / "a.bsp", kind, times)
    kernels = [path, *texts(tmp_path)]
    np.testing.assert_allclose(windows(kernels, max_gap_s=3600.0), [[0.0, 18_000.0]])
    np.testing.assert_allclose(windows(kernels, max_gap_s=600.0), np.column_stack([times, times]))


def test_a_path_without_states_counts_over_its_span(tmp_path: Path) -> None:
    kernels = [spk(tmp_path / "a.bsp", 2, np.array([0.0, 1e5])), *texts(tmp_path)]
    np.testing.assert_allclose(windows(kernels, max_gap_s=600.0), [[0.0, 1e5]])


@pytest.mark.parametrize("last", ["images", "mission"])
def test_the_kernel_that_answers_is_the_one_that_counts(tmp_path: Path, last: str) -> None:
    """SPICE asks the one loaded last, and asks no other over its whole span."""
    images = spk(tmp_path / "images.bsp", 9)
    mission = spk(tmp_path / "mission.bsp", 2, np.array([-1000.0, 50_000.0]))
    order = [mission, images] if last == "images" else [images, mission]
    found = windows([*order, *texts(tmp_path)], max_gap_s=600.0)
    if last == "mission":
        np.testing.assert_allclose(found, [[-1000.0, 50_000.0]])
    else:
        right = [[-1000.0, 540.0], [20_000.0, 20_000.0], [40_000.0, 50_000.0]]
        np.testing.assert_allclose(found, right)


@pytest.mark.parametrize("frame", [FRAME, "CRAFT_LIDAR"])
def test_attitudes_leave_gaps_too(tmp_path: Path, frame: str) -> None:
    path = spk(tmp_path / "a.bsp", 2, np.array([-1000.0, 50_000.0]))
    kernels = [path, ck(tmp_path / "a.bc"), *texts(tmp_path)]
    options = {"frame": frame, "max_gap_s": 600.0, "tolerance_s": 0.0}
    np.testing.assert_allclose(windows(kernels, **options), BURSTS, atol=1e-6)
    wider = windows(kernels, **{**options, "tolerance_s": 0.5})
    np.testing.assert_allclose(wider, BURSTS + np.array([-0.5, 0.5]), atol=1e-6)
    # Intervals that the CK itself ends are no more than they were.
    apart = [path, ck(tmp_path / "b.bc", starts=TIMES[[0, 10, 11]]), *texts(tmp_path)]
    np.testing.assert_allclose(windows(apart, frame=frame, tolerance_s=0.0), BURSTS, atol=1e-6)
    assert not len(windows([path, *texts(tmp_path)], frame=frame))


def test_a_time_beyond_the_end_takes_the_pointing_at_the_end(tmp_path: Path) -> None:
    """It costs the rate of rotation times how far it is beyond, and no more than the tolerance."""
    path = spk(tmp_path / "a.bsp", 2, np.array([-1000.0, 50_000.0]))
    with KernelSet([path, ck(tmp_path / "a.bc"), *texts(tmp_path)]).load():
        end = TIMES[-1]
        at_end = body_fixed_states("", BENNU, [end + 0.3], frame="J2000")[1][0]
        late = body_fixed_states("", BENNU, [end + 0.3], frame=FRAME, tolerance_s=0.5)
        turned = late[1][0]
        # The body has turned on; the spacecraft is where it pointed last.
        angle = np.arctan2(*(turned @ at_end.T)[0, 1::-1])
        assert (angle - RATE * end + np.pi) % (2 * np.pi) == pytest.approx(np.pi, abs=1e-9)
        known = [
            np.isfinite(
                body_fixed_states(CRAFT, BENNU, [end + 0.3], frame=FRAME, tolerance_s=tolerance)[1]
            ).all()
            for tolerance in (0.0, 0.2, 0.5)
        ]
    assert known == [False, False, True]


def test_what_covers_together() -> None:
    none = np.empty((0, 2))
    first = QuantityCoverage((Segment(0.0, 10.0, np.array([[2.0, 4.0]])), Segment(8.0, 20.0, none)))
    second = QuantityCoverage((Segment(3.0, 15.0, none), Segment(18.0, 18.0, none)))
    both = KernelCoverage((first, second))
    np.testing.assert_array_equal(both.windows(), [[4.0, 15.0], [18.0, 18.0]])
    assert both.covers([3.0, 4.0, 15.0, 16.0, 18.0]).tolist() == [False, True, True, False, True]
    assert not len(KernelCoverage((first, QuantityCoverage(()))).windows())


@pytest.mark.parametrize("count", [1e18, 0.0, -3.0, np.nan, np.inf, 1e300])
@pytest.mark.parametrize("kind", [8, 9, 18, 0])
def test_a_count_that_does_not_fit_is_refused(tmp_path: Path, kind: int, count: float) -> None:
    times = 60.0 * np.arange(21)
    path = ck(tmp_path / "a.bc", times) if kind == 0 else spk(tmp_path / "a.bsp", kind, times)
    content = bytearray(path.read_bytes())
    place = content.rfind(struct.pack("<d", 21.0))
    content[place : place + 8] = struct.pack("<d", count)
    path.write_bytes(content)
    spacecraft, frame = ("", FRAME) if kind == 0 else (CRAFT, "")
    with (
        pytest.raises(KernelError, match=r"a segment of \d+ numbers states|states in \d+ numbers"),
        KernelSet([path, *texts(tmp_path)]).load(),
    ):
        coverage(spacecraft, frame=frame)
