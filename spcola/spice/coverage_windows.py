"""Times at which loaded kernels give the position and pointing of a spacecraft.

SPICE interpolates between the states of a segment however far apart they are. An SPK or CK that was
made from images has one state an image: over hours between two of them nothing was measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import spiceypy
from numpy.typing import ArrayLike

from spcola.arrays import BoolArray, FloatArray
from spcola.errors import KernelError

# Types of SPK segments with discrete states: at listed epochs, the same with other packets, and at
# even steps. Of CK segments the one that interpolates linearly.
_LISTED, _MIXED, _SPACED = (5, 9, 13), 18, (8, 12)
_LINEAR_CK = 3
# Every so many-th epoch of such a segment is repeated in a directory after them.
_DIRECTORY = 100
# Classes of frames.
_CK_FRAME, _FIXED_FRAME = 3, 4
# Steps of a clock are first converted to seconds by their mean rate, then exactly if long.
_RATE_MARGIN = 0.999

_Found = tuple[int, tuple[float, float], tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class Segment:
    """A span of a kernel.

    Parameters
    ----------
    first, last : float
        Ephemeris times, s, both within it.
    gaps : (K, 2) ndarray
        Open intervals between neighbouring states, in order, that are too long to interpolate.
    """

    first: float
    last: float
    gaps: FloatArray

    def bridges(self, times: FloatArray) -> BoolArray:
        """Return which times (N,) lie in a gap."""
        if not len(self.gaps):
            return np.zeros(len(times), dtype=bool)
        place = np.maximum(np.searchsorted(self.gaps[:, 0], times) - 1, 0)
        return (times > self.gaps[place, 0]) & (times < self.gaps[place, 1])


@dataclass(frozen=True, eq=False)
class QuantityCoverage:
    """Segments with the same quantity, in the order in which SPICE searches them.

    Parameters
    ----------
    segments : tuple of Segment
        The first one that contains a time is used, also in its gaps.
    """

    segments: tuple[Segment, ...]

    def covers(self, times: FloatArray) -> BoolArray:
        """Return at which times (N,) the quantity is known."""
        known, unasked = np.zeros(len(times), dtype=bool), np.ones(len(times), dtype=bool)
        for segment in self.segments:
            inside = unasked & (times >= segment.first) & (times <= segment.last)
            known[inside] = ~segment.bridges(times[inside])
            unasked &= ~inside
        return known

    def marks(self) -> FloatArray:
        """Return the times at which coverage may begin or end."""
        ends = [np.array([segment.first, segment.last]) for segment in self.segments]
        gaps = [segment.gaps.ravel() for segment in self.segments]
        return np.unique(np.concatenate([np.empty(0), *ends, *gaps]))


@dataclass(frozen=True, eq=False)
class KernelCoverage:
    """Times at which several quantities are known together.

    Parameters
    ----------
    quantities : tuple of QuantityCoverage
    """

    quantities: tuple[QuantityCoverage, ...]

    def __and__(self, other: KernelCoverage) -> KernelCoverage:
        return KernelCoverage(self.quantities + other.quantities)

    def covers(self, times: ArrayLike) -> BoolArray:
        """Return at which ephemeris times (N,), s, all of them are known."""
        wanted = np.asarray(times, dtype=np.float64)
        return np.all(
            [np.ones(len(wanted), dtype=bool), *(one.covers(wanted) for one in self.quantities)],
            axis=0,
        )

    def windows(self) -> FloatArray:
        """Return the intervals (K, 2), s, over which all are known, in order; or single states."""
        marks = np.unique(np.concatenate([np.empty(0), *(one.marks() for one in self.quantities)]))
        if not len(marks):
            return np.empty((0, 2))
        at, between = self.covers(marks), self.covers((marks[:-1] + marks[1:]) / 2.0)
        left, right = np.append(False, between), np.append(between, False)
        alone = at & ~left & ~right
        begins = marks[alone | (right & ~(left & at))]
        return np.column_stack([begins, marks[alone | (left & ~(right & at))]])


def position_coverage(target: int, max_gap_s: float) -> QuantityCoverage:
    """Return when the loaded SPKs give the position of an object, by its NAIF number.

    States further apart than `max_gap_s`, seconds, are not interpolated between (types 5, 8, 9, 12,
    13 and 18); other types integrate or approximate a path, and cover their whole span.
    """
    found = []
    for handle, ends, integers in _segments("SPK"):
        if integers[0] == target:
            epochs = segment_epochs(handle, integers)
            found.append(Segment(*ends, _gaps(epochs, max_gap_s)))
    return QuantityCoverage(tuple(found))


def pointing_coverages(
    frame: str, max_gap_s: float, tolerance_s: float
) -> tuple[QuantityCoverage, ...]:
    """Return when the loaded CKs give the attitude of a frame: one item for each rotation.

    Attitudes further apart than `max_gap_s`, seconds, are not interpolated between (type 3); other
    types cover their whole span, as far as SPICE finds attitudes there. A time within
    `tolerance_s`, seconds, of a covered one counts as covered.
    """
    found = []
    number = spiceypy.namfrm(frame)
    while number:
        _, kind, class_number = spiceypy.frinfo(number)
        if kind == _FIXED_FRAME:
            _, number = spiceypy.tkfram(class_number)
        elif kind == _CK_FRAME:
            segments, number = _attitudes(class_number, max_gap_s, tolerance_s)
            found.append(QuantityCoverage(segments))
        else:
            number = 0
    return tuple(found)


def segment_epochs(handle: int, integers: tuple[int, ...]) -> FloatArray:
    """Return the epochs (K,), s, of the discrete states of an SPK segment; none of other types.

    Parameters
    ----------
    handle : int
        Handle of the open file.
    integers : tuple of int
        Target, centre, frame, type, first and last address: SPICE's segment descriptor.
    """
    kind, begin, end = integers[3:6]
    if kind in _LISTED:
        count = _count(_numbers(handle, end, end)[0], 7, begin, end)
        return _numbers(handle, begin + 6 * count, begin + 7 * count - 1)
    if kind == _MIXED:
        form, _, number = _numbers(handle, end - 2, end)
        packet = 6 if form else 12
        count = _count(number, packet + 1, begin, end)
        return _numbers(handle, begin + packet * count, begin + (packet + 1) * count - 1)
    if kind in _SPACED:
        first, step, _, number = _numbers(handle, end - 3, end)
        return np.asarray(first + step * np.arange(_count(number, 6, begin, end)))
    return np.empty(0)


def _attitudes(
    instrument: int, max_gap_s: float, tolerance_s: float
) -> tuple[tuple[Segment, ...], int]:
    """Return the segments of an instrument's attitudes, and their reference frame."""
    found: list[Segment] = []
    reference = 0
    for handle, ends, integers in _segments("CK"):
        if integers[0] != instrument:
            continue
        reference = reference or integers[1]
        clock = spiceypy.ckmeta(instrument, "SCLK")
        if integers[2] == _LINEAR_CK:
            ticks, starts = _linear_ck(handle, integers)
        else:
            ticks, starts = np.array(ends), np.array(ends[:1])
        first = np.searchsorted(ticks, starts)
        for part in filter(len, np.split(ticks, first[1:])):
            low, high = (spiceypy.sct2e(clock, float(tick)) for tick in part[[0, -1]])
            gaps: FloatArray = np.empty((0, 2))
            if integers[2] == _LINEAR_CK and high - low > max_gap_s:
                gaps = _long_steps(part, clock, (high - low) / (part[-1] - part[0]), max_gap_s)
                gaps += [tolerance_s, -tolerance_s]
                gaps = gaps[gaps[:, 0] < gaps[:, 1]]
            found.append(Segment(low - tolerance_s, high + tolerance_s, gaps))
    return tuple(found), reference


def _long_steps(ticks: FloatArray, clock: int, rate: float, max_gap_s: float) -> FloatArray:
    """Return the steps (K, 2), ephemeris s, longer than the allowed gap.

    Only steps that are long by the mean rate of the clock, seconds per tick, are converted.
    """
    long = np.flatnonzero(np.diff(ticks) * rate > _RATE_MARGIN * max_gap_s)
    found = [[spiceypy.sct2e(clock, float(ticks[k + end])) for end in (0, 1)] for k in long]
    steps = np.array(found).reshape(-1, 2)
    return np.asarray(steps[steps[:, 1] - steps[:, 0] > max_gap_s])


def _linear_ck(handle: int, integers: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the ticks of the attitudes of a CK segment of type 3, and of its intervals' starts."""
    begin, end = integers[4:6]
    packet = 7 if integers[3] else 4
    written = _numbers(handle, end - 1, end)
    count = _count(written[1], packet + 1, begin, end)
    intervals = _count(written[0], 1, begin, end)
    begin += packet * count
    ticks = _numbers(handle, begin, begin + count - 1)
    begin += count + (count - 1) // _DIRECTORY
    return ticks, _numbers(handle, begin, begin + intervals - 1)


def _segments(kind: str) -> Iterator[_Found]:
    """Yield handle, ends and integers of all loaded segments of a type, in SPICE's order."""
    for number in reversed(range(spiceypy.ktotal(kind))):
        handle = spiceypy.kdata(number, kind)[3]
        yield from reversed(list(segments_of(handle)))


def segments_of(handle: int) -> Iterator[_Found]:
    """Yield handle, ends and integers of the segments of an open SPK or CK, in its order."""
    spiceypy.dafbfs(handle)
    while spiceypy.daffna():
        ends, whole = spiceypy.dafus(spiceypy.dafgs(5), 2, 6)
        yield handle, (float(ends[0]), float(ends[1])), tuple(int(number) for number in whole)


def _count(number: float, each: int, begin: int, end: int) -> int:
    """Return the `number` of items in a segment; a KernelError if they do not fit in it."""
    if not 1 <= number * each <= end - begin + 1:
        raise KernelError(
            f"a segment of {end - begin + 1} numbers states {number:g} states or attitudes",
            "SPK or CK",
            "get the kernel again",
        )
    return int(number)


def _numbers(handle: int, begin: int, end: int) -> FloatArray:
    """Return the numbers at addresses `begin` to `end` of an open DAF."""
    return np.asarray(spiceypy.dafgda(handle, begin, end), dtype=np.float64)


def _gaps(epochs: FloatArray, max_gap_s: float) -> FloatArray:
    """Return the intervals (K, 2) between neighbouring epochs longer than the allowed gap."""
    long = np.flatnonzero(np.diff(epochs) > max_gap_s)
    return np.column_stack([epochs[long], epochs[long + 1]])
