"""Kernels made to crash, hang or fill the memory: each is refused in one line, at once."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from spcola.errors import FormatError, KernelError
from spcola.spice import KernelSet, orientation_of, read_transfer
from spcola.spice.daf import check_daf, daf_segments, state_epochs
from spcola.spice.text_kernel import expand_meta_kernels
from spcola.spice.transfer import Daf, DafArray, encode_daf

NINES = "9" * 5000


def kernel(path: Path, data: str) -> Path:
    path.write_text(f"KPL/PCK\n\\begindata\n{data}\n\\begintext\n")
    return path


@pytest.mark.parametrize("data", ["A" * 200_000, "A" * 200_000 + " " * 200_000, "A " * 100_000])
def test_a_long_word_in_a_kernel_takes_no_time(tmp_path: Path, data: str) -> None:
    """It took the square of its length, minutes for a file of 200 kB."""
    path = kernel(tmp_path / "a.tpc", f"{data}\nBODY1_PM = ( 1 2 )")
    assert orientation_of(path).constants == {"BODY1_PM": (1.0, 2.0)}


def test_numbers_of_bodies_are_those_of_spice(tmp_path: Path) -> None:
    path = kernel(tmp_path / "a.tpc", f"BODY{NINES}_PM = ( 1 2 )\nBODY7_PM = ( 3 4 )")
    assert orientation_of(path).bodies == (7,)
    kernel(path, f"BODY7_PM = ( {NINES} 1 )")
    with pytest.raises(KernelError, match="is not a list of numbers"):
        orientation_of(path)


def test_meta_kernels_that_list_themselves_or_explode_are_refused(tmp_path: Path) -> None:
    one, other = tmp_path / "one.tm", tmp_path / "other.tm"
    kernel(one, "KERNELS_TO_LOAD = ( 'other.tm' )")
    kernel(other, "KERNELS_TO_LOAD = ( 'one.tm' )")
    with pytest.raises(KernelError, match="lists itself"):
        expand_meta_kernels([one])
    symbols = " ".join(f"'S{n:02d}X'" for n in range(40))
    values = " ".join(f"'$S{n + 1:02d}X$S{n + 1:02d}X'" for n in range(40))
    names = f"PATH_SYMBOLS = ( {symbols} )\nPATH_VALUES = ( {values} )"
    kernel(one, f"{names}\nKERNELS_TO_LOAD = ( '$S00X' )")
    with pytest.raises(KernelError, match="no path"):
        expand_meta_kernels([one])


TRANSFER = """DAFETF NAIF DAF ENCODED TRANSFER FILE
'DAF/SPK '
'{nd}'
'6'
'{name}'
BEGIN_ARRAY 1 {count}
'SEGMENT'
'1^1'
'{number}'
'{integer}'
'A'
'1'
'9'
1
'8^0'
END_ARRAY 1 {count}
TOTAL_ARRAYS 1
"""


GOOD_TRANSFER = {"nd": "2", "name": "x", "count": "1", "number": "1^1", "integer": "1"}


@pytest.mark.parametrize(
    "changed",
    [
        {"number": "1^FFFFFFFFFFFFFFFFFFF"},
        {"number": "F" * 400 + "^1"},
        {"number": "1_0^1"},
        {"integer": "FFFFFFFFF"},
        {"integer": "1_0"},
        {"count": NINES},
        {"count": "99999999999"},
        {"nd": "7C"},
    ],
)
def test_transfer_files_that_no_daf_can_hold_are_refused(
    tmp_path: Path, changed: dict[str, str]
) -> None:
    path = tmp_path / "a.xsp"
    path.write_text(TRANSFER.format(**GOOD_TRANSFER))
    assert len(read_transfer(path).arrays) == 1
    path.write_text(TRANSFER.format(**GOOD_TRANSFER | changed))
    with pytest.raises(FormatError, match=r"a\.xsp, line"):
        read_transfer(path)


def test_an_empty_line_in_a_transfer_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.xsp"
    path.write_text(TRANSFER.format(**GOOD_TRANSFER).replace("BEGIN", "\nBEGIN"))
    with pytest.raises(FormatError, match=r"a\.xsp, line 6: BEGIN_ARRAY 1 was expected, not ''"):
        read_transfer(path)


@pytest.mark.parametrize(
    ("at", "form", "value"),
    [
        (8, "<i", 124),  # doubles of a summary
        (12, "<i", 250),  # its integers
        (76, "<i", 2**31 - 1),  # first record of summaries
        (1024, "<d", 2.0),  # a record that follows itself
        (1040, "<d", 1e9),  # summaries in it
        (1024 + 24 + 16 + 16, "<i", -5),  # first word of a segment
        (1024 + 24 + 16 + 20, "<i", 2**31 - 1),  # last word
        (3072 + 8 * 29, "<d", 1e15),  # number of states
    ],
)
def test_binary_kernels_are_checked_before_spice_follows_them(
    tmp_path: Path, at: int, form: str, value: float
) -> None:
    """Each of them ended the process, or read beyond the file."""
    states = np.zeros((4, 6))
    states[:, 0] = 10.0
    times = 6e8 + np.arange(4.0)
    values = np.concatenate([states.ravel(), times, [3.0, 4.0]])
    segment = DafArray("ONE", (times[0], times[3]), (-64, 2101955, 1, 9), values)
    content = bytearray(encode_daf(Daf("DAF/SPK ", 2, 6, "x", (segment,))))
    path = tmp_path / "a.bsp"
    path.write_bytes(content)
    np.testing.assert_array_equal(state_epochs(daf_segments(path)[0].values, path), times)
    with KernelSet(path).load():
        pass
    struct.pack_into(form, content, at, value)
    path.write_bytes(content)
    for read in (check_daf, lambda path: KernelSet(path).load().__enter__()):
        with pytest.raises(KernelError, match=r"a\.bsp"):
            read(path)
