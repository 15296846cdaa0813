"""Tables inside ISIS cubes, by bytes and on real cubes."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from spcola.errors import FormatError
from spcola.formats.images import read_isis_tables

TABLE = """Object = Table
  Name = Mixed
  StartByte = {start}
  Bytes = {size}
  Records = {records}
  ByteOrder = {order}
  FrameTypeCode = 3
  PoleRa = (85.5, 0.0)
  Group = Field
    Name = ET
    Type = Double
    Size = 1
  End_Group
  Group = Field
    Name = Pair
    Type = Real
    Size = 2
  End_Group
  Group = Field
    Name = Count
    Type = Integer
    Size = 1
  End_Group
  Group = Field
    Name = Word
    Type = Text
    Size = 6
  End_Group
End_Object
"""


def cube(samples, pixels, stored, **changes):
    """A cube with a table of three records after its pixels."""
    mark = "<" if stored == "Lsb" else ">"
    rows = b"".join(
        struct.pack(f"{mark}dffi6s", 1e8 + k, k, -k, 7 * k, b"Lat\0xx") for k in range(3)
    )
    entries = {"start": 4097 + pixels.nbytes, "size": len(rows), "records": 3, "order": stored}
    table = TABLE.format(**(entries | changes))
    return samples.isis_bytes(pixels, "UnsignedWord", tables=table) + rows


@pytest.mark.parametrize("order", ["Lsb", "Msb"])
def test_fields_of_every_type(samples, tmp_path, ramp, order) -> None:
    path = tmp_path / "a.cub"
    path.write_bytes(cube(samples, ramp, order))
    table = read_isis_tables(path)["Mixed"]
    assert len(table) == 3
    assert list(table.columns) == ["ET", "Pair", "Count", "Word"]
    np.testing.assert_array_equal(table.columns["ET"], [1e8, 1e8 + 1, 1e8 + 2])
    np.testing.assert_array_equal(table.columns["Pair"], [[0, 0], [1, -1], [2, -2]])
    np.testing.assert_array_equal(table.columns["Count"], [0, 7, 14])
    assert table.columns["Word"].tolist() == ["Lat"] * 3
    assert table.keywords == {"FrameTypeCode": 3, "PoleRa": [85.5, 0.0]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"records": 4}, "gives 4 records of 26 bytes, but 78 bytes"),
        ({"start": 99999}, "lies at bytes 99999 to 100076"),
        ({"order": "Mixed"}, "gives no ByteOrder"),
        ({"start": "many"}, "gives no number for StartByte"),
    ],
)
def test_tables_that_contradict_their_file(samples, tmp_path, ramp, change, message) -> None:
    path = tmp_path / "a.cub"
    path.write_bytes(cube(samples, ramp, "Lsb", **change))
    with pytest.raises(FormatError, match=message):
        read_isis_tables(path)


def test_a_cube_without_tables(samples, tmp_path, ramp) -> None:
    path = tmp_path / "a.cub"
    path.write_bytes(samples.isis_bytes(ramp, "UnsignedWord"))
    assert read_isis_tables(path) == {}


# Records of pointing, position, rotation and Sun; first and last ET.
CUBES = {
    "apollo15/AS15-M-0297_crop.cub": ((1, 1, 1, 1), -896956456.5737045, -896956456.5737045),
    "apollo15/AS15-M-0298_crop.cub": ((1, 1, 1, 1), -896956431.3597045, -896956431.3597045),
    "apollo15/AS15-M-0299_crop.cub": ((1, 1, 1, 1), -896956406.1477045, -896956406.1477045),
    "isis_cubes/20200303T213031S138_ncm_L0-reduced.cub": (
        (1, 1, 1, 1), 636543100.2986277, 636543100.2986277,
    ),
    "isis_cubes/M143947267L.cal.echo.crop.cub": (
        (4, 3, 2, 2), 342580072.37562287, 342580072.74045724,
    ),
}  # fmt: skip
NAMES = ("InstrumentPointing", "InstrumentPosition", "BodyRotation", "SunPosition")


@pytest.mark.real_data
@pytest.mark.parametrize("name", CUBES)
def test_tables_of_real_cubes(shared_data, name) -> None:
    tables = read_isis_tables(shared_data / name)
    counts, first, last = CUBES[name]
    assert tuple(len(tables[table]) for table in NAMES) == counts
    for table in NAMES:
        times = tables[table].columns["ET"]
        assert (times[0], times[-1]) == (first, last)
        key = "CkTable" if table in ("InstrumentPointing", "BodyRotation") else "SpkTable"
        start, end = (tables[table].keywords[f"{key}{part}Time"] for part in ("Start", "End"))
        assert (start, end) == pytest.approx((first, last), abs=1e-4)
    for table in ("InstrumentPointing", "BodyRotation"):
        parts = [tables[table].columns[f"J2000Q{k}"] for k in range(4)]
        np.testing.assert_allclose(np.linalg.norm(parts, axis=0), 1.0, atol=1e-12)
    sun = [tables["SunPosition"].columns[f"J2000{axis}"] for axis in "XYZ"]
    np.testing.assert_allclose(np.linalg.norm(sun, axis=0), 1.5e8, rtol=0.1)


@pytest.mark.real_data
def test_values_of_real_tables(shared_data) -> None:
    tables = read_isis_tables(shared_data / "isis_cubes/M143947267L.cal.echo.crop.cub")
    pointing, position = tables["InstrumentPointing"], tables["InstrumentPosition"]
    turns, places = pointing.columns["J2000Q0"], position.columns["J2000X"]
    assert (turns[0], turns[-1]) == (0.4379872554874791, 0.4381308250854488)
    assert (places[0], places[-1]) == (-1414.9420694898208, -1415.3089452815302)
    assert pointing.keywords["TimeDependentFrames"] == [-85600, -85000, 1]
    assert len(tables["BodyRotation"].keywords["ConstantRotation"]) == 9
    apollo = read_isis_tables(shared_data / "apollo15/AS15-M-0297_crop.cub")["CameraStatistics"]
    assert apollo.columns["Name"][[0, -1]].tolist() == ["Latitude", "NorthAzimuth"]
    assert apollo.columns["Minimum"][0] == pytest.approx(-24.518278884157)
