"""Orientation of bodies in text PCKs: all constants of SPICE's rotation."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from spcola.errors import KernelError
from spcola.spice.text_kernel import assignments, is_text

HEADS: Mapping[str, tuple[str, ...]] = {
    "POLE_RA": ("NUT_PREC_RA",),
    "POLE_DEC": ("NUT_PREC_DEC",),
    "PM": ("NUT_PREC_PM",),
    "NUT_PREC_ANGLES": ("MAX_PHASE_DEGREE",),
}
"""Constants of a kernel, and those that it implies to be zero."""

_FRAME = ("CONSTANTS_REF_FRAME", "CONSTANTS_JED_EPOCH")
# SPICE's number of J2000 and its Julian date: the defaults.
_PLAIN = {"CONSTANTS_REF_FRAME": 1.0, "CONSTANTS_JED_EPOCH": 2_451_545.0}
_OF_BARYCENTER = ("NUT_PREC_ANGLES", "MAX_PHASE_DEGREE", *_FRAME)
_OF_BODY = ("POLE_RA", "NUT_PREC_RA", "POLE_DEC", "NUT_PREC_DEC", "PM", "NUT_PREC_PM")
_NAME = re.compile(rf"BODY(-?[0-9]{{1,10}})_({'|'.join((*_OF_BODY, *_OF_BARYCENTER, 'RADII'))})$")

Values = tuple[float, ...]


@dataclass(frozen=True)
class Orientation:
    """Orientation of bodies in one text kernel.

    Parameters
    ----------
    path : Path
    constants : mapping of str to tuple of float
        By SPICE's names (``BODY2101955_PM``), in degrees, days and Julian centuries, km.
    """

    path: Path
    constants: Mapping[str, Values]

    @property
    def bodies(self) -> tuple[int, ...]:
        """NAIF numbers of the bodies whose pole or prime meridian is stated."""
        names = [name.split("_", 1) for name in self.constants]
        heads = {"POLE_RA", "POLE_DEC", "PM"}
        return tuple(sorted({int(body[4:]) for body, item in names if item in heads}))

    def get(self, body: int, item: str) -> Values:
        """Return a constant of a body, such as ``PM``; empty if it is not stated."""
        return self.constants.get(constant(body, item), ())

    def stated(self, body: int) -> dict[str, Values]:
        """Return all that the kernel states for a body; a constant that it leaves zero is empty.

        A prime meridian without nutation terms implies that there are none. Without a frame and an
        epoch, constants are those of J2000.
        """
        found: dict[str, Values] = {}
        for head, tails in HEADS.items():
            if constant(body, head) in self.constants:
                frame = _FRAME if head in _OF_BODY else ()
                names = [constant(body, item) for item in (head, *tails, *frame)]
                found |= {name: self.constants.get(name, ()) for name in names}
        known = {constant(body, item) for item in (*_OF_BODY, *_OF_BARYCENTER)}
        return found | {name: v for name, v in self.constants.items() if name in known}

    def beyond_spin(self, body: int) -> tuple[str, ...]:
        """Return the constants of a body's rotation that `Spin` does not include.

        These are periodic terms, the square of the centuries in the pole, another frame than J2000
        or another epoch.
        """
        found = []
        for item in (*_OF_BODY, *_FRAME):
            name = constant(body, item)
            rest = self.constants.get(name, ())
            # Degree 1 in the pole and 2 in the prime meridian are included.
            rest = rest[{"POLE_RA": 2, "POLE_DEC": 2, "PM": 3}.get(item, 0) :]
            if any(number != _PLAIN.get(item, 0.0) for number in rest):
                found.append(name)
        return tuple(found)


def orientation_of(path: Path) -> Orientation:
    """Return the orientations in the kernel at `path`; none for any other than a text kernel.

    Raises
    ------
    KernelError
        If a constant is not a list of numbers.
    """
    constants: dict[str, Values] = {}
    if is_text(path):
        for name, operator, text in assignments(path):
            if _NAME.match(name):
                before = constants.get(name, ()) if operator == "+=" else ()
                constants[name] = (*before, *_numbers(name, text, path))
    return Orientation(path, constants)


def constant(body: int, item: str) -> str:
    """Return SPICE's name of an `item`, such as ``POLE_RA``, of a `body` (NAIF number).

    Angles, frame and epoch belong to the barycentre.
    """
    number = barycenter(body) if item in _OF_BARYCENTER else body
    return f"BODY{number}_{item}"


def barycenter(body: int) -> int:
    """Return the NAIF number of the barycentre of a planet's system; of other bodies their own."""
    if 100 <= body <= 999:
        return body // 100
    return body // 10_000 if 10_000 <= body <= 99_999 else body


def _numbers(name: str, text: str, path: Path) -> Values:
    """Return the numbers of an assignment; Fortran's exponents are D."""
    words = re.findall(r"[^\s,()]+", text)
    try:
        numbers = tuple(float(word.upper().replace("D", "E")) for word in words)
    except ValueError:
        raise KernelError(f"{name} is not a list of numbers", path, "correct it") from None
    if not numbers:
        raise KernelError(f"{name} is empty", path, "correct it")
    if not all(map(math.isfinite, numbers)):
        raise KernelError(f"{name} is not a list of numbers", path, "correct it")
    return numbers
