from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import spiceypy

from spcola.errors import FormatError
from spcola.navigation import SPICE_LOCK
from spcola.spice import read_transfer
from spcola.spice.transfer import (
    Daf,
    DafArray,
    convert_transfer,
    decode_double,
    encode_daf,
    is_transfer,
)

GOOD = """DAFETF NAIF DAF ENCODED TRANSFER FILE
'DAF/SPK '
'2'
'6'
'MADE BY HAND                                                '
BEGIN_ARRAY 1 3
'ONE SEGMENT                             '
'1^1'
'-28^2'
'-40'
'A'
'1'
'9'
2
'8^0'
'-C^0'
1
'1^-1'
END_ARRAY 1 3
TOTAL_ARRAYS 1
 ~NAIF/SPC BEGIN COMMENTS~
first

third
 ~NAIF/SPC END COMMENTS~
"""


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("1^1", 1.0),
        ("-28^2", -40.0),
        ("8^0", 0.5),
        ("1^-1", 1 / 256),
        ("0^0", 0.0),
        ("FF8^3", 4088.0),
        ("3243F6A8885A3^1", math.pi),
        ("100000C55B42EA^-3", float(0x100000C55B42EA) * 2.0**-68),
    ],
)
def test_encoded_numbers(text: str, number: float) -> None:
    assert decode_double(text) == pytest.approx(number, rel=1e-15)


def write(folder: Path, text: str) -> Path:
    path = folder / "segment.xsp"
    path.write_text(text)
    return path


def test_reads_every_field(tmp_path: Path) -> None:
    daf = read_transfer(write(tmp_path, GOOD))
    (array,) = daf.arrays
    assert (daf.word, daf.doubles, daf.integers) == ("DAF/SPK ", 2, 6)
    assert daf.internal_name.strip() == "MADE BY HAND"
    assert daf.comments == ("first", "", "third")
    assert array.name.strip() == "ONE SEGMENT"
    assert array.doubles == (1.0, -40.0)
    assert array.integers == (-64, 10, 1, 9)
    np.testing.assert_array_equal(array.values, [0.5, -0.75, 1 / 256])


def test_spice_reads_what_was_written(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    arrays = tuple(
        DafArray(f"ARRAY {i}", (float(i), i + 0.5), (-i, i, 1, 9), rng.normal(size=50 + 7 * i))
        for i in range(60)  # three summary records
    )
    comments = tuple(f"comment {i} " + "x" * (i % 70) for i in range(60))
    path = tmp_path / "many.bsp"
    path.write_bytes(encode_daf(Daf("DAF/SPK ", 2, 6, "MANY", arrays, comments)))
    with SPICE_LOCK:
        handle = spiceypy.dafopr(str(path))
        try:
            spiceypy.dafbfs(handle)
            for array in arrays:
                assert spiceypy.daffna()
                doubles, integers = spiceypy.dafus(spiceypy.dafgs(5), 2, 6)
                assert spiceypy.dafgn(100).strip() == array.name
                assert tuple(doubles) == array.doubles
                assert tuple(integers[:4]) == array.integers
                values = spiceypy.dafgda(handle, int(integers[4]), int(integers[5]))
                np.testing.assert_array_equal(values, array.values)
            assert not spiceypy.daffna()
            count, lines, done = spiceypy.dafec(handle, 100, 200)
            assert (count, bool(done)) == (60, True)
            assert [line.rstrip() for line in lines[:count]] == [line.rstrip() for line in comments]
        finally:
            spiceypy.dafcls(handle)


def test_a_file_without_arrays_or_comments(tmp_path: Path) -> None:
    path = tmp_path / "empty.bsp"
    path.write_bytes(encode_daf(Daf("DAF/SPK ", 2, 6, "NOTHING", ())))
    with SPICE_LOCK:
        handle = spiceypy.dafopr(str(path))
        try:
            spiceypy.dafbfs(handle)
            assert not spiceypy.daffna()
        finally:
            spiceypy.dafcls(handle)


LINES = GOOD.splitlines()


@pytest.mark.parametrize("number", range(1, LINES.index("TOTAL_ARRAYS 1") + 2))
def test_every_corrupted_line_is_refused_and_named(tmp_path: Path, number: int) -> None:
    if number in (5, 7):
        pytest.skip("a name may be anything")
    lines = [*LINES]
    lines[number - 1] = "?"
    path = write(tmp_path, "\n".join(lines))
    with pytest.raises(FormatError, match=r"segment\.xsp, line \d+"):
        read_transfer(path)


@pytest.mark.parametrize("kept", range(len(LINES) - 1))
def test_a_truncated_file_is_refused(tmp_path: Path, kept: int) -> None:
    if kept == LINES.index("TOTAL_ARRAYS 1") + 1:
        pytest.skip("whole but for its comments, which are optional")
    path = write(tmp_path, "\n".join(LINES[:kept]))
    target = tmp_path / "segment.bsp"
    with pytest.raises(FormatError):
        convert_transfer(path, target)
    assert not target.exists()


def test_recognition_and_binary_rubbish(tmp_path: Path) -> None:
    path = write(tmp_path, GOOD)
    assert is_transfer(path)
    path.write_bytes(bytes(range(256)))
    assert not is_transfer(path)
    with pytest.raises(FormatError, match="not text"):
        read_transfer(path)


@pytest.mark.real_data
def test_all_real_transfer_files_give_kernels_that_spice_reads(
    shared_data: Path, tmp_path: Path
) -> None:
    sources = sorted((shared_data / "bennu" / "kernels_mapcam_20190303").glob("*.x*"))
    assert len(sources) == 6
    for source in sources:
        daf = read_transfer(source)
        target = tmp_path / f"{source.stem}.bin"
        convert_transfer(source, target)
        with SPICE_LOCK:
            handle = spiceypy.dafopr(str(target))
            try:
                spiceypy.dafbfs(handle)
                for array in daf.arrays:
                    assert spiceypy.daffna()
                    _, integers = spiceypy.dafus(spiceypy.dafgs(5), 2, 6)
                    values = spiceypy.dafgda(handle, int(integers[4]), int(integers[5]))
                    np.testing.assert_array_equal(values, array.values)
            finally:
                spiceypy.dafcls(handle)
