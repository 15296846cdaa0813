"""Files made to crash, hang or fill the memory: each is refused in one line, at once.

Each case is the smallest file that once did it.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Callable
from pathlib import Path

import h5py
import laspy
import numpy as np
import pytest
from command_line import app
from typer.testing import CliRunner

from fusion.workspace import Workspace
from fusion.workspace.settings import load_settings
from lidar.formats import open_lidar, read_scan
from lidar.formats.native import ScanFile, scan_summary, write_scan
from lidar.scans import Scan
from spcola.errors import FormatError, SpcolaError
from spcola.formats.hdf5 import reading_hdf5, replacing_hdf5, stored
from spcola.formats.images import read_fits_image
from spcola.formats.shapes import read_icq, read_obj_mesh, read_shape, write_icq, write_obj_mesh
from spcola.shape.icq import IcqShape, icq_directions

POINTS = np.random.default_rng(5).normal(size=(60, 3)) * 250.0


BALL = IcqShape(250.0 * icq_directions(2))


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    path = tmp_path / "a.h5"
    write_scan(path, [Scan.of_points("a", POINTS)], digest="d")
    return path


def soft_link_loop(file: h5py.File) -> None:
    del file["block00000/place"]
    file["block00000/place"] = h5py.SoftLink("/block00000/place")


def packed(file: h5py.File) -> None:
    values, kept = file["block00000/place"][:], dict(file["block00000/place"].attrs)
    del file["block00000/place"]
    file["block00000"].create_dataset("place", data=values, compression="gzip").attrs.update(kept)


def of_another_type(file: h5py.File) -> None:
    values, kept = file["block00000/place"][:], dict(file["block00000/place"].attrs)
    del file["block00000/place"]
    file["block00000"].create_dataset("place", data=values.view("i8")).attrs.update(kept)


def group_for_layer(file: h5py.File) -> None:
    del file["block00000/cube"]
    file.create_group("block00000/cube")


def attribute(name: str, value: object, group: str = "/") -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        file[group].attrs[name] = value

    return edit


SCANS: dict[str, Callable[[h5py.File], None]] = {
    "a loop of links": soft_link_loop,
    "packed": packed,
    "of another type": of_another_type,
    "a group for a layer": group_for_layer,
    "a list for a number": attribute("bits", [16, 16], "block00000"),
    "a number beyond its range": attribute("bits", 64, "block00000"),
    "not a number": attribute("bits", np.nan, "block00000"),
    "a list for the count": attribute("count", [60]),
    "a number for a text": attribute("name", 3),
    "bytes that are no text": attribute("body", np.bytes_(b"\xff\xfe")),
    "a list for a mapping": attribute("rejected", "[1, 2]"),
    "a text for a count": attribute("rejected", '{"noise": "many"}'),
    "nesting": attribute("parameters", "[" * 50_000),
    "more blocks than there are": attribute("blocks", 2**40),
    "one bound": attribute("bounds_m", [1.0]),
    "a list for the format": attribute("format", ["SPCOLA scan"]),
}


@pytest.mark.parametrize("case", SCANS)
def test_scans_that_are_none_are_refused(scan: Path, case: str) -> None:
    with h5py.File(scan, "r+") as file:
        SCANS[case](file)
    with pytest.raises(FormatError, match=r"a\.h5: .*import the source again"):
        list(ScanFile(scan).chunks(10))


def test_a_flipped_bit_in_the_structures_of_hdf5_is_never_followed(tmp_path: Path) -> None:
    """All that HDF5 keeps about its content has a sum; old files had none, and hung."""
    path = tmp_path / "a.h5"
    with replacing_hdf5(path) as file:
        file.attrs["format"] = stored("a form")
        file.create_group("one").attrs["text"] = stored("a word")
        file["one/values"] = np.arange(3.0)
    content = path.read_bytes()
    with h5py.File(path, "r") as file:
        begin = file["one/values"].id.get_offset()
    refused = 0
    for at in range(8, len(content)):
        if begin <= at < begin + 24:
            continue  # the values: who keeps them keeps their sum
        flipped = bytearray(content)
        flipped[at] ^= 1 << at % 8
        path.write_bytes(flipped)
        try:
            with reading_hdf5(path, "a form", "is damaged", "make it again") as file:
                seen = (file["one"].attrs["text"], file["one/values"][:].tolist())
            assert seen == (b"a word", [0.0, 1.0, 2.0])
        except FormatError:
            refused += 1
    assert refused > 300


LAZ = {
    "chunks without end": ("table", 4, 0xFFFFFFFF),
    "a chunk of a thousand million": ("record", 12, 0x3FFFFFFF),
    "a layer of two thousand million bytes": ("layers", 4, 0x7FFFFFFF),
    "its table behind the end": ("points", 0, 1 << 40),
}


@pytest.mark.parametrize("case", LAZ)
def test_sizes_in_laz_are_compared_with_the_file_before_they_are_used(
    tmp_path: Path, case: str
) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 1e-3)
    file = laspy.LasData(header)
    file.x, file.y, file.z = POINTS.T
    path = tmp_path / "a.laz"
    file.write(path)
    assert len(read_scan(path)) == len(POINTS)
    content = bytearray(path.read_bytes())
    points = struct.unpack_from("<I", content, 96)[0]
    begin = {
        "points": points,
        "table": struct.unpack_from("<q", content, points)[0],
        "record": content.index(b"laszip encoded") - 2 + 54,
        "layers": points + 8 + 30 + 4,
    }
    where, offset, value = LAZ[case]
    size = 8 if where == "points" else 4
    at = begin[where] + offset
    content[at : at + size] = value.to_bytes(size, "little")
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.laz, chunk table"):
        read_scan(path)


NINES = "9" * 5000


PCD = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 {}\nWIDTH {}\nHEIGHT 1\n"


CLOUDS = {
    "a field of 1e8": PCD.format(100_000_000, 1) + "POINTS 1\nDATA ascii\n1 2 3\n",
    "points of 5000 digits": PCD.format(1, NINES) + f"POINTS {NINES}\nDATA ascii\n1 2 3\n",
    "points without end": PCD.format(1, 10**17) + f"POINTS {10**17}\nDATA ascii\n1 2 3\n",
    "packed without end": PCD.format(1, 3 * 10**8)
    + f"POINTS {3 * 10**8}\nDATA binary_compressed\n"
    + struct.pack("<II", 8, 36 * 10**8 % 2**32).decode("latin-1")
    + "x" * 8,
    "a header without end": "ply\nformat ascii 1.0\nelement camera 999999999999999999\n"
    "property float x\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
    "end_header\n1\n",
}


@pytest.mark.parametrize("case", CLOUDS)
def test_counts_of_clouds_are_bounded_by_the_file(tmp_path: Path, case: str) -> None:
    path = tmp_path / "a.cloud"
    path.write_bytes(CLOUDS[case].encode("latin-1"))
    with pytest.raises(FormatError, match=r"a\.cloud"):
        list(open_lidar(path, format="cloud"))


PLY = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
PLY += "property float z\nelement face 1\nproperty list {} int vertex_indices\nend_header\n"
PLY += "0 0 0\n1 0 0\n0 1 0\n{} 0 1 2\n"


@pytest.mark.parametrize(
    ("vertices", "kind", "corners"),
    [(NINES, "uchar", 3), (3, "float", "nan"), (3, "uchar", "1e300"), (3, "uchar", "-3")],
)
def test_counts_of_meshes_are_counts(
    tmp_path: Path, vertices: object, kind: str, corners: object
) -> None:
    path = tmp_path / "a.ply"
    path.write_text(PLY.format(vertices, kind, corners))
    with pytest.raises(FormatError, match=r"a\.ply, line"):
        read_shape(path)


@pytest.mark.parametrize("form", ["icq", "obj"])
def test_the_mark_by_which_dos_ends_a_text_is_no_part_of_it(tmp_path: Path, form: str) -> None:
    path = tmp_path / "a.txt"
    if form == "icq":
        write_icq(path, BALL)
    else:
        write_obj_mesh(path, BALL.mesh())
    read = read_icq if form == "icq" else read_obj_mesh
    content = path.read_bytes()
    before = read(path).vertices
    path.write_bytes(content + b"\x1a")
    np.testing.assert_array_equal(read(path).vertices, before)
    for other in (b"\x01", b"\x1c", b"\x00"):
        path.write_bytes(content.replace(b"\n", b"\n " + other + b" ", 3))
        with pytest.raises(FormatError, match=r"a\.txt, line"):
            read(path)


def test_a_long_number_in_a_shape_takes_no_time(tmp_path: Path) -> None:
    """It took the square of its digits, half of a minute for 50 kB."""
    path = tmp_path / "a.txt"
    path.write_text("1" * 300_000 + "x\n")
    with pytest.raises(FormatError, match="is no shape"):
        read_shape(path)


def fits(cards: dict[str, str], size: int = 2880) -> bytes:
    lines = [f"{key:<8}= {value:>20}".ljust(80) for key, value in cards.items()]
    return "".join([*lines, "END".ljust(80)]).ljust(size).encode() + bytes(2880)


GOOD_FITS = {"SIMPLE": "T", "BITPIX": "8", "NAXIS": "2", "NAXIS1": "4", "NAXIS2": "4"}


@pytest.mark.parametrize(
    "changed",
    [
        *({"BITPIX": value} for value in ("7", "'x'", "1e5", "-1", NINES[:60])),
        *({"SIMPLE": value} for value in ("F", "1", "'x'")),
        *({"NAXIS": value} for value in ("-1", "100000000", "nan", "T")),
        *({"NAXIS1": value} for value in ("-4", "4000000000000", "'4'")),
    ],
)
def test_fits_headers_that_are_none_are_one_line(tmp_path: Path, changed: dict[str, str]) -> None:
    path = tmp_path / "a.fits"
    path.write_bytes(fits(GOOD_FITS | changed))
    with pytest.raises(FormatError, match=r"a\.fits") as caught:
        read_fits_image(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["[" * 50_000, '{"a":' * 50_000, f'{{"a": {NINES}}}'])
def test_json_without_end_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(SpcolaError, match=r"a\.json: is not JSON"):
        Workspace(tmp_path).read_json("a.json")


def test_json_that_is_nested_too_deep_to_be_printed_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"a":' * 900 + "1" + "}" * 900)
    result = CliRunner().invoke(app, ["info", str(path), "--json"])
    assert result.exit_code == 1
    assert "unexpected" not in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("text", ["a = " + "[" * 50_000, f"a = {NINES}", "a" + ".a" * 20_000])
def test_settings_without_end_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "spcola.toml").write_text(text)
    with pytest.raises(SpcolaError, match=r"spcola\.toml") as caught:
        load_settings(tmp_path / "spcola.toml")
    assert len(str(caught.value)) < 2000


@pytest.mark.parametrize("name", ["pipe", "/dev/zero"])
@pytest.mark.parametrize("form", [None, "ola", "table"])
def test_pipes_and_devices_are_no_files(tmp_path: Path, name: str, form: str | None) -> None:
    path = tmp_path / name
    if name == "pipe":
        os.mkfifo(path)
    with pytest.raises(FormatError, match="is a pipe or a device"):
        open_lidar(path, format=form)
    with pytest.raises(FormatError, match="is a pipe or a device"):
        read_shape(path)
    with pytest.raises(FormatError, match="is a pipe or a device"):
        scan_summary(path)
    root = tmp_path / "ws"
    assert CliRunner().invoke(app, ["init", str(root)]).exit_code == 0
    result = CliRunner().invoke(app, ["import", str(root), str(path), "--name", "a"])
    assert result.exit_code == 1
    assert "is a pipe or a device" in result.stderr


def test_a_file_whose_name_is_no_utf8_is_imported_and_named(tmp_path: Path) -> None:
    root, path = tmp_path / "ws", tmp_path / os.fsdecode(b"\xff\xfe.csv")
    try:
        path.write_text("x_m,y_m,z_m\n1,2,3\n4,5,6\n")
    except OSError:
        pytest.skip("this file system takes no such names")
    CliRunner().invoke(app, ["init", str(root)])
    refused = CliRunner().invoke(app, ["import", str(root), str(path)])
    assert refused.exit_code == 1
    assert "\\udcff\\udcfe.csv" in refused.stderr
    for state in ("imported", "imported already"):
        command = ["import", str(root), str(path), "--name", "a", "--json"]
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 0, done.output
        (scan,) = json.loads(done.stdout)["scans"]
        assert scan["state"] == state
        assert os.fsencode(scan["file"]) == os.fsencode(path)
    done = CliRunner().invoke(app, ["import", str(root), str(path), "--name", "a"])
    assert "\\udcff\\udcfe.csv: imported already" in done.stdout


def test_messages_hold_nothing_that_a_terminal_obeys() -> None:
    text = str(FormatError("has \x1b[2J\x07 and \u2028 in it", os.fsdecode(b"a\xff")))
    assert text.isprintable()
    assert "\\u001b" in text
    assert len(str(FormatError("x" * 100_000, "a", "mend it"))) < 500
