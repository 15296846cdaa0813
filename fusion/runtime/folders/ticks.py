"""Whether the times of a file show every change of it."""

from __future__ import annotations

# Longest tick of the kernel's clock, and of file systems.
_TICK_NS, _COARSE_TICK_NS = 10_000_000, 2_000_000_000


def may_hide_a_change(changed_ns: int, *, since: int) -> bool:
    """Return whether a file may have changed unseen, though its status is as it was.

    A change within the same tick of the clock as the last one leaves no trace in the status of a
    file. So a file that changed just before it was looked at is doubtful (git calls it racily
    clean). The tick is that of the kernel, or two seconds where the file system keeps no
    fractions of a second.

    Parameters
    ----------
    changed_ns : int
        Time of the last status change of the file, which no program can set, ns since 1970.
    since : int
        When it was looked at, ns since 1970.
    """
    tick = _TICK_NS if changed_ns % _TICK_NS else _COARSE_TICK_NS
    return changed_ns > since - tick
