"""The rotation of a body in a text PCK, as a value."""

from __future__ import annotations

from pathlib import Path

from spcola.errors import KernelError
from spcola.navigation import Spin
from spcola.spice.pck import constant, orientation_of


def spin_of(path: str | Path, body: int) -> Spin:
    """Return pole, prime meridian and their rates of a body in a text PCK.

    Parameters
    ----------
    path : str or Path
    body : int
        NAIF number.

    Raises
    ------
    KernelError
        If the kernel does not state them, or has terms that `Spin` does not include.
    """
    source = Path(path)
    found = orientation_of(source)
    beyond = found.beyond_spin(body)
    if beyond:
        raise KernelError(
            f"states {', '.join(beyond)}, which a plain pole and spin do not include",
            source,
            "give a PCK without periodic terms, relative to J2000",
        )
    values = {}
    for item in ("POLE_RA", "POLE_DEC", "PM"):
        given = found.constants.get(constant(body, item))
        if given is None:
            raise KernelError(f"does not state {constant(body, item)}", source, "give another PCK")
        values[item] = (*given, 0.0, 0.0, 0.0)
    ra, dec, meridian = values["POLE_RA"], values["POLE_DEC"], values["PM"]
    return Spin(ra[0], dec[0], meridian[0], meridian[1], meridian[2], ra[1], dec[1])
