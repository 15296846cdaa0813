"""Check that kernels agree about the rotation of a body, and choice of one where they do not.

SPICE stores one value of each constant, that of the kernel loaded last. Kernels with other values,
or with terms that another leaves zero, are mixed without a warning: here that is an error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import spiceypy
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.errors import KernelError
from spcola.navigation import SPICE_LOCK, utc_from_et
from spcola.spice.pck import Orientation, Values, constant, orientation_of

AGREEMENT_DEG = 1e-6
"""Rotations with smaller differences over the times of use count as equal: 5 µm on Bennu."""

# Times of use if unknown: within half a Julian century (36525 days of 86400 s) of J2000.
_TIMES = np.linspace(-0.5, 0.5, 41) * 36525.0 * 86400.0
# Constants are tested on a body of this number, which no kernel has.
_SPARE = 9_999_999
_M_PER_KM = 1000.0
_MOST_NAMED = 3


@dataclass(frozen=True)
class KernelUse:
    """Use of kernels: constants of other bodies may differ.

    Parameters
    ----------
    body : int
        NAIF number of the body.
    extent : callable
        Returns the ephemeris times (N,), s, at which its rotation is used, and the radius, m, at
        which a contradiction is stated where no kernel gives the body's radii; none and 0 where
        unknown. It is only called where kernels differ.
    setting : str
        The setting by which a user chooses a kernel.
    """

    body: int
    extent: Callable[[], tuple[FloatArray, float]]
    setting: str = "prime_meridian"


def resolve_rotation(
    paths: Sequence[Path], choice: str | Path | None, use: KernelUse | None
) -> tuple[list[Path], tuple[str, ...]]:
    """Return kernels in loading order, the chosen one last, and constants to be removed then.

    The chosen kernel replaces all statements about a body: terms that it does not have are removed
    from the pool, if another kernel put them there.

    Parameters
    ----------
    paths : sequence of Path
        Kernels, in the order in which they are given.
    choice : str or Path, optional
        Name or path of the chosen text kernel.
    use : KernelUse, optional
        By default all bodies are checked, over the century around J2000.

    Raises
    ------
    KernelError
        If two kernels disagree about the rotation of a body and no choice resolves it, or `choice`
        is not the name of one of the kernels that state one.
    """
    order = list(paths)
    every = [found for path in dict.fromkeys(order) if (found := orientation_of(path)).constants]
    bodies = [use.body] if use else sorted({body for one in every for body in one.bodies})
    chosen = None
    if choice is not None:
        stating = [one for one in every if any(map(one.stated, bodies))]
        chosen = _chosen(stating, choice, use.setting if use else "prime_meridian")
        order = [path for path in order if path != chosen.path] + [chosen.path]
        every = [one for one in every if one is not chosen] + [chosen]
    dropped: set[str] = set()
    for body in bodies:
        resolved = chosen.stated(body) if chosen else {}
        dropped |= {name for name, values in resolved.items() if not values}
        _refuse_disagreement(body, every, resolved, use)
    return order, tuple(sorted(dropped))


def _chosen(stating: list[Orientation], choice: str | Path, setting: str) -> Orientation:
    """Return the kernel of that path or name among those that state a rotation."""
    found = [one for one in stating if one.path == Path(choice) or one.path.name == str(choice)]
    if len(found) != 1:
        names = ", ".join(sorted({one.path.name for one in stating})) or "none of the kernels"
        raise KernelError(
            f"{str(choice)!r} is not one kernel with the rotation of the body",
            setting,
            f"choose from: {names}",
        )
    return found[0]


def _refuse_disagreement(
    body: int, every: list[Orientation], resolved: Mapping[str, Values], use: KernelUse | None
) -> None:
    """Refuse kernels whose rotation of a body differs from that of all of them together."""
    stated = [(one, one.stated(body)) for one in every]
    pool: dict[str, Values] = {}
    source: dict[str, Path] = {}
    for one, constants in stated:
        written = {name: values for name, values in constants.items() if values}
        pool |= written
        source |= dict.fromkeys(written, one.path)
    pool |= resolved
    for one, constants in stated:
        own = {name: values for name, values in constants.items() if name not in resolved}
        differing = [name for name, values in own.items() if not _same(values, pool.get(name, ()))]
        if not differing:
            continue
        times, radius = use.extent() if use else (_TIMES, 0.0)
        times = times if len(times) else _TIMES
        angle = _angle_between(body, pool, {**pool, **own}, times)
        if angle <= AGREEMENT_DEG:
            continue
        radii = [km for of in every for km in of.constants.get(f"BODY{body}_RADII", ())]
        radius = _M_PER_KM * max(radii) if radii else radius
        named = [
            f"{name} is {_text(own[name])}, but {_text(pool.get(name, ()))}"
            + (f" in {source[name].name}" if name in source else "")
            for name in differing[:_MOST_NAMED]
        ]
        named += [f"{len(differing) - _MOST_NAMED} more"] * (len(differing) > _MOST_NAMED)
        raise KernelError(
            f"{'; '.join(named)}: {_effect(angle, radius, times)}",
            one.path,
            f"choose one of them as {use.setting if use else 'prime_meridian'}",
        )


def _same(first: Values, second: Values) -> bool:
    """Whether two lists of coefficients are equal; missing ones are zero."""
    size = max(len(first), len(second))
    return (*first, *[0.0] * (size - len(first))) == (*second, *[0.0] * (size - len(second)))


def _angle_between(
    body: int, first: Mapping[str, Values], second: Mapping[str, Values], times: FloatArray
) -> float:
    """Return the largest angle, degrees, between two rotations; NaN where one is incomplete."""
    one, other = _axes(body, first, times), _axes(body, second, times)
    if one is None or other is None:
        return float("nan")
    change = one @ np.swapaxes(other, 1, 2)
    return float(np.degrees(Rotation.from_matrix(change).magnitude().max()))


def _axes(body: int, constants: Mapping[str, Values], times: FloatArray) -> FloatArray | None:
    """Return SPICE's axes (N, 3, 3) in J2000 from constants; None if these are too few."""
    items = ["POLE_RA", "POLE_DEC", "PM", "NUT_PREC_RA", "NUT_PREC_DEC", "NUT_PREC_PM"]
    items += ["NUT_PREC_ANGLES", "MAX_PHASE_DEGREE", "CONSTANTS_REF_FRAME", "CONSTANTS_JED_EPOCH"]
    values = {item: constants.get(constant(body, item), ()) for item in items}
    put = [f"BODY{_SPARE}_{item}" for item in items if values[item]]
    with SPICE_LOCK:
        try:
            for name in put:
                spiceypy.pdpool(name, list(values[name.split("_", 1)[1]]))
            return np.array([spiceypy.tipbod("J2000", _SPARE, time) for time in times])
        except spiceypy.utils.exceptions.SpiceyError:
            return None
        finally:
            for name in put:
                spiceypy.dvpool(name)


def _text(values: Values) -> str:
    """Return coefficients as in a kernel, with all significant digits."""
    if not values:
        return "not stated"
    return f"({', '.join(f'{value:.12g}' for value in values)})"


def _effect(angle: float, radius: float, times: FloatArray) -> str:
    """Return the effect on the body over the times of use."""
    if not np.isfinite(angle):
        return "one of them does not state the whole rotation"
    metres = ""
    if radius > 0:
        chord = 2.0 * radius * np.sin(np.radians(angle) / 2.0)
        metres = f" or {chord:.3g} m at a radius of {radius:.4g} m"
    first, last = (utc_from_et(time, 0)[:11] for time in (times.min(), times.max()))
    return f"turned by up to {angle:.3g} deg{metres}, {first} to {last}"
