"""SPICE kernels as one set: expanded, checked for contradictions, loaded and unloaded.

CSPICE has one pool for the whole process; a set holds `SPICE_LOCK` while it is loaded, so that
other threads wait, and restores the pool afterwards.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import spiceypy
from numpy.typing import ArrayLike

from spcola.arrays import FloatArray
from spcola.errors import KernelError
from spcola.navigation import SPICE_LOCK
from spcola.spice.coverage_windows import (
    KernelCoverage,
    QuantityCoverage,
    pointing_coverages,
    position_coverage,
)
from spcola.spice.daf import check_daf, is_daf
from spcola.spice.rotation_check import KernelUse, resolve_rotation
from spcola.spice.text_kernel import expand_meta_kernels
from spcola.spice.transfer import convert_transfer, is_transfer

M_PER_KM = 1000.0

POINTING_TOLERANCE_S = 1e-3
"""Default for the distance in time to the next pointing of a CK, seconds."""

# Accuracy of the end of a CK's coverage, seconds.
_NEAREST_S = 1e-6
NOT_COVERED = (
    spiceypy.utils.exceptions.SpiceSPKINSUFFDATA,
    spiceypy.utils.exceptions.SpiceNOFRAMECONNECT,
    spiceypy.utils.exceptions.SpiceCKINSUFFDATA,
)


class KernelSet:
    """Kernels that are loaded together.

    Parameters
    ----------
    paths : path or sequence of paths
        Kernels in the order of loading; meta-kernels are replaced by their lists, DAF transfer
        text (.xsp, .xc) is converted on loading.
    prime_meridian : str, optional
        Name (or path) of the kernel to use where several disagree about the rotation of a
        body: pole, prime meridian, their rates and periodic terms. It is loaded last, and terms
        of others that it does not have are removed.
    use : KernelUse, optional
        The body and times of use. By default kernels may disagree about no body.

    Raises
    ------
    KernelError
        If a kernel is missing, two disagree about a body's rotation and none was chosen, or the
        chosen one does not state it.
    """

    def __init__(
        self,
        paths: str | Path | Sequence[str | Path],
        *,
        prime_meridian: str | Path | None = None,
        use: KernelUse | None = None,
    ) -> None:
        given = [paths] if isinstance(paths, (str, Path)) else list(paths)
        expanded = expand_meta_kernels([Path(path) for path in given])
        self.paths, self._dropped = resolve_rotation(expanded, prime_meridian, use)

    @contextmanager
    def load(self) -> Iterator[None]:
        """Keep the kernels loaded (and the SPICE lock) for the length of a ``with`` block.

        Raises
        ------
        KernelError
            If SPICE refuses a kernel; those loaded before it are unloaded again.
        """
        with SPICE_LOCK, tempfile.TemporaryDirectory(prefix="spcola-kernels-") as folder:
            loaded: list[str] = []
            before = _loaded()
            try:
                for index, path in enumerate(self.paths):
                    ready = _ready(path, Path(folder) / str(index))
                    # SPICE stores the name of a kernel that it refused, and reads it again later.
                    loaded.append(str(ready))
                    with kernel_errors(path):
                        spiceypy.furnsh(str(ready))
                for name in self._dropped:
                    spiceypy.dvpool(name)
                yield
            finally:
                _give_back(loaded, before)


def body_fixed_states(
    spacecraft: str | int,
    body: int,
    times: ArrayLike,
    *,
    frame: str = "",
    tolerance_s: float = POINTING_TOLERANCE_S,
) -> tuple[FloatArray, FloatArray]:
    """Return body-fixed positions (N, 3), m, and axes (N, 3, 3) of a frame, at ephemeris times.

    Positions are geometric; rows of the axes are the frame's x, y, z. NaN at times that the kernels
    do not cover. The body's rotation is that of the loaded PCK (SPICE's ``tipbod``), so no frame
    kernel is needed. To be called inside ``KernelSet.load()``.

    A CK made from images ends at its first and last image by the clock kernel of its day (0.12 s
    off by a later one, as in real files): where it does not cover a time, the nearest time within
    `tolerance_s` is used. The error is at most the spacecraft's rate of rotation times that.

    Parameters
    ----------
    spacecraft : str or int
        Name or NAIF number; empty for axes alone, with NaN as positions.
    body : int
        NAIF number.
    times : (N,) array_like
        Ephemeris times, s.
    frame : str
        Frame whose axes are returned; empty for the body's.
    tolerance_s : float
        Tolerance of the pointing in time, seconds.

    Raises
    ------
    KernelError
        If a name is unknown, or the kernels do not give the body's rotation.
    """
    wanted = np.asarray(times, dtype=np.float64)
    positions = np.full((len(wanted), 3), np.nan)
    axes = np.full((len(wanted), 3, 3), np.nan)
    with SPICE_LOCK, kernel_errors(f"{spacecraft} at {body} in {frame or 'the body frame'}"):
        for index, et in enumerate(wanted):
            turn = spiceypy.tipbod("J2000", body, et)
            try:
                inertial = np.full(3, np.nan)
                if spacecraft:
                    inertial, _ = spiceypy.spkpos(str(spacecraft), et, "J2000", "NONE", str(body))
                to_inertial = rotation_near(frame, et, tolerance_s) if frame else turn.T
            except NOT_COVERED:
                continue
            positions[index], axes[index] = M_PER_KM * (turn @ inertial), (turn @ to_inertial).T
    return positions, axes


def coverage(
    spacecraft: str | int,
    *,
    frame: str = "",
    max_gap_s: float = np.inf,
    tolerance_s: float = POINTING_TOLERANCE_S,
) -> KernelCoverage:
    """Return when the loaded kernels give the position of a spacecraft and pointing of a frame.

    To be called inside ``KernelSet.load()``. States and attitudes further apart than `max_gap_s`,
    seconds, are not interpolated between; see :mod:`spcola.spice.coverage_windows`.

    Parameters
    ----------
    spacecraft : str or int
        Name or NAIF number; empty for the pointing only.
    frame : str
        Frame of an instrument or the spacecraft; without one only the position is checked.
    max_gap_s, tolerance_s : float
        Longest gap; and distance in time to a pointing of a CK at which another counts as known.

    Raises
    ------
    KernelError
        If a name is unknown, or a kernel cannot be read.
    """
    quantities: tuple[QuantityCoverage, ...] = ()
    where = f"coverage of {spacecraft or frame}"
    with SPICE_LOCK, kernel_errors(where):
        if spacecraft:
            try:
                target = spiceypy.bods2c(str(spacecraft))
            except spiceypy.utils.exceptions.NotFoundError:
                raise KernelError(
                    "is a name unknown to SPICE and the kernels", str(spacecraft), "give its number"
                ) from None
            quantities = (position_coverage(target, max_gap_s),)
        if frame:
            quantities += pointing_coverages(frame, max_gap_s, tolerance_s)
    return KernelCoverage(quantities)


def rotation_near(frame: str, et: float, tolerance_s: float) -> FloatArray:
    """Return the rotation (3, 3) from a frame to J2000 at a time, or at the nearest known one.

    It is searched within a tolerance, and found to a microsecond.
    """
    try:
        return np.asarray(spiceypy.pxform(frame, "J2000", et))
    except spiceypy.utils.exceptions.SpiceNOFRAMECONNECT:
        found = _rotation_aside(frame, et, tolerance_s)
        if found is None:
            raise
    unknown, known = 0.0, tolerance_s
    while known - unknown > _NEAREST_S:
        middle = (unknown + known) / 2.0
        nearer = _rotation_aside(frame, et, middle)
        if nearer is None:
            unknown = middle
        else:
            found, known = nearer, middle
    return found


def _rotation_aside(frame: str, et: float, by: float) -> FloatArray | None:
    """Return the rotation from a frame to J2000 `by` seconds after a time (or before)."""
    for time in (et + by, et - by):
        try:
            return np.asarray(spiceypy.pxform(frame, "J2000", time))
        except spiceypy.utils.exceptions.SpiceNOFRAMECONNECT:
            continue
    return None


def _ready(path: Path, target: Path) -> Path:
    """Return a kernel that SPICE can load: `path` itself, or its conversion at `target`."""
    if not is_transfer(path):
        if is_daf(path):
            check_daf(path)
        return path
    convert_transfer(path, target)
    return target


def _loaded() -> list[str]:
    """Return the names of the kernels that SPICE has loaded."""
    return [spiceypy.kdata(index, "ALL")[0] for index in range(spiceypy.ktotal("ALL"))]


def _give_back(loaded: Sequence[str], before: Sequence[str]) -> None:
    """Unload kernels, so that SPICE has the earlier ones loaded again.

    It reads all text kernels anew whenever one is unloaded, and stops at a wrong or missing one.
    """
    try:
        for name in reversed(loaded):
            spiceypy.unload(name)
    except (spiceypy.utils.exceptions.SpiceyError, UnicodeEncodeError):
        spiceypy.kclear()
        for name in before:
            with suppress(spiceypy.utils.exceptions.SpiceyError):
                spiceypy.furnsh(name)


@contextmanager
def kernel_errors(where: str | Path) -> Iterator[None]:
    """Turn SPICE's errors into one line."""
    try:
        yield
    except spiceypy.utils.exceptions.SpiceyError as error:
        # "Not found" errors have no long message.
        message = getattr(error, "long", "") or getattr(error, "short", "") or error
        first = str(message).split(". ")[0]
        what = f"SPICE reports: {first.rstrip('.')}"
        raise KernelError(what, where, "check kernels and times") from error
    except UnicodeEncodeError as error:
        what = "has a name that is not UTF-8, which SPICE cannot open"
        raise KernelError(what, where, "rename it") from error
