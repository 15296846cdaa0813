"""Small good SPICE kernels, text and binary, and their readers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from fuzz_rows import CRAFT, TIMES

from spcola.spice import KernelSet, body_fixed_states, read_transfer
from spcola.spice.daf import daf_segments, state_epochs
from spcola.spice.transfer import Daf, DafArray, encode_daf

KERNEL = r"""KPL/PCK
Anything may stand here.
\begindata
   BODY2101955_POLE_RA  = ( 85.65  0.  0. )
   BODY2101955_POLE_DEC = ( -60.17 0.  0. )
   BODY2101955_PM       = ( 140.69 2011.14 0. )
   BODY2101955_RADII    = ( .25 .25 .25 )
   PATH_VALUES  = ( '.' )
   PATH_SYMBOLS = ( 'HERE' )
   DELTET/DELTA_AT = ( 10,   @1972-JAN-1
                       11,   @1972-JUL-1 )
\begintext
And here.
\begindata
   NAMES += ( 'one' 'two+'
              'three' )
\begintext
"""
META = r"""KPL/MK
\begindata
   PATH_VALUES  = ( '.' )
   PATH_SYMBOLS = ( 'HERE' )
   KERNELS_TO_LOAD = ( '$HERE/a.tpc' 'a+'
                       '.tpc' )
\begintext
"""


def write_meta_kernel(folder: Path) -> Path:
    (folder / "a.tpc").write_text(KERNEL)
    (folder / "meta.tm").write_text(META)
    return folder / "meta.tm"


def _daf() -> Daf:
    """An SPK of type 9: four states, their times, the degree and their number."""
    states = np.column_stack([CRAFT[:4] / 1e3, np.zeros((4, 3))]).ravel()
    values = np.concatenate([states, TIMES[:4], [3.0, 4.0]])
    array = DafArray("ONE SEGMENT".ljust(40), (TIMES[0], TIMES[3]), (-64, 2101955, 1, 9), values)
    return Daf("DAF/SPK ", 2, 6, "MADE BY HAND".ljust(60), (array,), ("first", "second"))


def _hexadecimal(value: float) -> str:
    """Return a number in the notation of transfer files."""
    if value == 0:
        return "0^0"
    exponent, whole = 0, abs(value)
    while whole >= 1:
        whole, exponent = whole / 16, exponent + 1
    while whole < 1 / 16:
        whole, exponent = whole * 16, exponent - 1
    digits = f"{int(whole * 16**14):014X}".rstrip("0")
    return f"{'-' if value < 0 else ''}{digits}^{'-' if exponent < 0 else ''}{abs(exponent):X}"


def transfer_text() -> bytes:
    daf = _daf()
    array = daf.arrays[0]
    lines = ["DAFETF NAIF DAF ENCODED TRANSFER FILE", "'DAF/SPK '", "'2'", "'6'"]
    lines += [f"'{daf.internal_name}'", f"BEGIN_ARRAY 1 {len(array.values)}", f"'{array.name}'"]
    lines += [f"'{_hexadecimal(value)}'" for value in array.doubles]
    lines += [f"'{'-' if code < 0 else ''}{abs(code):X}'" for code in array.integers]
    lines += [str(len(array.values)), *(f"'{_hexadecimal(v)}'" for v in array.values)]
    lines += [f"END_ARRAY 1 {len(array.values)}", "TOTAL_ARRAYS 1", " ~NAIF/SPC BEGIN COMMENTS~"]
    return ("\n".join([*lines, "first", "", " ~NAIF/SPC END COMMENTS~"]) + "\n").encode()


def read_kernels(path: Path) -> None:
    with KernelSet(path).load():
        pass


def read_spk(path: Path) -> None:
    # A damaged file may have no segment.
    states = [state_epochs(one.values, path) for one in daf_segments(path)]
    times = np.concatenate([np.empty(0), *states])
    with KernelSet([path, path.parent / "a.tpc"]).load():
        body_fixed_states(-64, 2101955, times[:4])


def read_transfer_file(path: Path) -> None:
    read_transfer(path)
    read_kernels(path)


def write_spk(folder: Path) -> Path:
    (folder / "a.tpc").write_text(KERNEL.replace("DELTET/DELTA_AT", "OTHER"))
    (folder / "a.bsp").write_bytes(encode_daf(_daf()))
    return folder / "a.bsp"
