"""Text kernels from assignments: rotation, clock, and the list of kernels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from spcola.navigation import Spin
from spcola.spice.pck import constant

_SECONDS = 4_294_967_296
_ITEMS_A_LINE = 3


def kernel_text(kind: str, about: Iterable[str], items: Mapping[str, object]) -> str:
    """Return a text kernel.

    Parameters
    ----------
    kind : str
        Such as PCK.
    about : iterable of str
        Lines before the data.
    items : mapping of str to object
        Values by names: numbers, quoted texts, or tuples of them; a name that ends in + appends.
    """
    lines = [f"KPL/{kind}", "", *about, "", "\\begindata"]
    for name, value in items.items():
        left = f"  {name}= " if name.endswith("+") else f"  {name} = "
        if isinstance(value, tuple):
            words = [_word(item) for item in value]
            rows = [words[i : i + _ITEMS_A_LINE] for i in range(0, len(words), _ITEMS_A_LINE)]
            lines += [f"{left}(", *(f"    {' '.join(row)}" for row in rows), "  )"]
        else:
            lines.append(left + _word(value))
    return "\n".join([*lines, "\\begintext", ""])


def meta_kernel_text(about: str, files: Iterable[str]) -> str:
    """Return the meta-kernel of `files` in its own folder, in the order of loading.

    `about` is a sentence on them.
    """
    lines = "".join(f"    '$KERNELS/{name}'\n" for name in files)
    return (
        f"KPL/MK\n\n{about} Load it from its own folder, or write\n"
        "that folder into PATH_VALUES.\n\n\\begindata\n"
        "  PATH_SYMBOLS = ( 'KERNELS' )\n  PATH_VALUES = ( '.' )\n"
        f"  KERNELS_TO_LOAD = (\n{lines}  )\n\\begintext\n"
    )


def clock_items(clock: int, start: float, ticks_per_s: int) -> dict[str, object]:
    """Return the assignments of an SCLK that counts seconds of TDB evenly.

    Parameters
    ----------
    clock : int
        Its number, negative.
    start : float
        Ephemeris time at which it begins, s.
    ticks_per_s : int
    """
    key = -clock
    return {
        "SCLK_KERNEL_ID": "@2000-01-01",
        f"SCLK_DATA_TYPE_{key}": 1,
        f"SCLK01_TIME_SYSTEM_{key}": 1,
        f"SCLK01_N_FIELDS_{key}": 2,
        f"SCLK01_MODULI_{key}": (_SECONDS, ticks_per_s),
        f"SCLK01_OFFSETS_{key}": (0, 0),
        f"SCLK01_OUTPUT_DELIM_{key}": 1,
        f"SCLK_PARTITION_START_{key}": 0.0,
        f"SCLK_PARTITION_END_{key}": float(_SECONDS * ticks_per_s),
        f"SCLK01_COEFFICIENTS_{key}": (0.0, start, 1.0),
    }


def frame_items(name: str, number: int, kind: int, own: int, center: int) -> dict[str, object]:
    """Return the assignments of an FK for a frame.

    Parameters
    ----------
    name : str
    number : int
    kind, own : int
        Class of the frame, and its number in that class.
    center : int
        NAIF number of its centre.
    """
    return {
        f"FRAME_{name}": number,
        f"FRAME_{number}_NAME": f"'{name}'",
        f"FRAME_{number}_CLASS": kind,
        f"FRAME_{number}_CLASS_ID": own,
        f"FRAME_{number}_CENTER": center,
    }


def rotation_items(body: int, spin: Spin, radius_m: float) -> dict[str, object]:
    """Return the assignments of a PCK: pole, prime meridian, radii.

    Parameters
    ----------
    body : int
        NAIF number.
    spin : Spin
    radius_m : float
        Mean radius; 0 for none.
    """
    values = {
        "POLE_RA": (spin.pole_ra_deg, spin.pole_ra_rate_deg_per_century, 0.0),
        "POLE_DEC": (spin.pole_dec_deg, spin.pole_dec_rate_deg_per_century, 0.0),
        "PM": (spin.meridian_deg, spin.rate_deg_per_day, spin.quadratic_deg_per_day2),
    }
    items: dict[str, object] = {constant(body, key): value for key, value in values.items()}
    if radius_m > 0.0:
        items[f"BODY{body}_RADII"] = (radius_m / 1000.0,) * 3
    return items


def _word(value: object) -> str:
    """Return a value as text, numbers with all their digits."""
    return repr(float(value)) if isinstance(value, float) else str(value)
