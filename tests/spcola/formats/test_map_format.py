"""The .MAP format: bytes built field by field, round trips, and every field corrupted."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spcola.errors import FormatError, InvalidValueError
from spcola.formats.maplets import (
    read_map,
    read_maplet,
    read_sigma,
    sigma_path,
    write_maplet,
)
from spcola.formats.maplets.map_header import MapHeader, map_length
from spcola.formats.maplets.sigma import write_sigma
from spcola.grids import Maplet, MapletGrid

Q = 2
SIZE = 2 * Q + 1
COUNTS = np.arange(SIZE**2, dtype=np.int16) * 1000 - 12000
ALBEDOS = np.arange(90, 90 + SIZE**2, dtype=np.uint8)
UX, UY, UZ = (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
HSCALE = struct.unpack(">f", struct.pack(">f", 1.5 / 30000))[0]
GSD_KM = struct.unpack(">f", struct.pack(">f", 0.00035))[0]


def map_bytes(**changes: bytes) -> bytes:
    """Return a .MAP file built field by field, some fields replaced."""
    fields = {
        "leading": b"DOUBLE",
        "gsd": struct.pack(">f", 0.00035),
        "q": struct.pack("<H", Q),
        "direction": bytes([255, 128, 3]),
        "center": struct.pack(">3f", 0.25, -0.125, 0.0625),
        "axes": struct.pack(">9f", *UX, *UY, *UZ),
        "hscale": struct.pack(">f", 1.5 / 30000),
        "size": struct.pack(">f", 0.002),
        "version": struct.pack("b", -7),
    } | changes
    header = b"".join(fields.values())
    nodes = b"".join(
        struct.pack(">hB", count, albedo) for count, albedo in zip(COUNTS, ALBEDOS, strict=True)
    )
    nodes = nodes[:9] + struct.pack(">hB", 0, 0) + nodes[12:]  # the fourth point is missing
    return header + nodes + bytes(-len(nodes) % 72)


@pytest.fixture
def good(tmp_path: Path) -> Path:
    path = tmp_path / "OLA001.MAP"
    path.write_bytes(map_bytes())
    return path


def test_every_field_is_read_in_its_unit(good):
    file = read_map(good)
    grid = file.maplet.grid
    assert file.maplet.name == "OLA001"
    assert grid.half_size == Q
    assert grid.gsd == GSD_KM * 1000.0
    np.testing.assert_array_equal(grid.center, [250.0, -125.0, 62.5])
    np.testing.assert_array_equal(grid.axes, [UX, UY, UZ])
    expected = np.array([255, 128, 3]) / 255 * 2.0
    np.testing.assert_allclose(file.maplet.center_sigma, expected, rtol=1e-7)
    assert (file.header.leading, file.header.version) == (b"DOUBLE", -7)
    assert file.header.hscale == HSCALE


def test_the_slow_index_runs_along_ux(good):
    maplet = read_map(good).maplet
    # Point k of the file: j = k // 5 − 2 along Ux, i = k % 5 − 2 along Uy.
    for k in (0, 1, 4, 7, 24):
        j, i = k // SIZE - Q, k % SIZE - Q
        height = COUNTS[k] * HSCALE * GSD_KM * 1000.0
        assert maplet.height[i + Q, j + Q] == pytest.approx(height, abs=1e-12)
        assert maplet.albedo[i + Q, j + Q] == ALBEDOS[k] / 100.0
        step = GSD_KM * 1000.0
        point = maplet.grid.center + step * (j * np.array(UX) + i * np.array(UY))
        np.testing.assert_allclose(
            maplet.points()[i + Q, j + Q], point + height * np.array(UZ), atol=1e-12
        )


def test_albedo_byte_zero_is_a_missing_point(good):
    maplet = read_map(good).maplet
    assert np.argwhere(~maplet.valid).tolist() == [[3, 0]]
    assert np.isnan(maplet.albedo[3, 0])


def test_an_untouched_file_is_rewritten_byte_for_byte(good, tmp_path):
    file = read_map(good)
    write_maplet(tmp_path / "again.MAP", file.maplet, header=file.header)
    assert (tmp_path / "again.MAP").read_bytes() == good.read_bytes()


def test_what_hides_behind_missing_points_and_in_the_padding_is_kept(tmp_path):
    content = bytearray(map_bytes())
    content[72 + 9 : 72 + 11] = struct.pack(">h", -321)
    content[-1] = 7
    path = tmp_path / "odd.MAP"
    path.write_bytes(content)
    file = read_map(path)
    write_maplet(tmp_path / "again.MAP", file.maplet, header=file.header)
    assert (tmp_path / "again.MAP").read_bytes() == bytes(content)


def test_length_is_whole_records():
    assert map_length(49) == 29520
    for q in range(1, 30):
        assert map_length(q) % 72 == 0
        assert 0 <= map_length(q) - 72 - 3 * (2 * q + 1) ** 2 < 72


@pytest.mark.real_data
def test_the_real_file_is_rewritten_byte_for_byte(shared_data, tmp_path):
    path = shared_data / "bennu" / "OLA001.MAP"
    file = read_map(path)
    missing = np.argwhere(~file.maplet.valid)
    # 40 points: slow index (columns here) 5 … 8, fast index (rows) 80 … 89.
    assert len(missing) == 40
    assert missing.min(axis=0).tolist() == [80, 5]
    assert missing.max(axis=0).tolist() == [89, 8]
    assert file.maplet.grid.half_size == 49
    assert file.maplet.grid.gsd == pytest.approx(1.0, abs=1e-7)
    write_maplet(tmp_path / "again.MAP", file.maplet, header=file.header)
    assert (tmp_path / "again.MAP").read_bytes() == path.read_bytes()


def example_maplet(heights: np.ndarray, gsd: float = 0.35, **more) -> Maplet:
    grid = MapletGrid.facing([200.0, 30.0, 140.0], [0.8, 0.1, 0.6], gsd, heights.shape[0] // 2)
    return Maplet("TEST01", grid, heights, **more)


@settings(max_examples=60)
@given(
    q=st.integers(1, 6),
    seed=st.integers(0, 2**32 - 1),
    amplitude=st.floats(1e-4, 1e5),
    gsd=st.floats(1e-3, 50.0),
)
def test_round_trip_stays_within_half_a_quantum(tmp_path_factory, q, seed, amplitude, gsd):
    rng = np.random.default_rng(seed)
    shape = (2 * q + 1, 2 * q + 1)
    heights = rng.uniform(-amplitude, amplitude, shape)
    heights[rng.random(shape) < 0.2] = np.nan
    albedo = rng.uniform(0.0, 2.55, shape)
    maplet = example_maplet(heights, gsd, albedo=albedo, center_sigma=rng.uniform(0, 2, 3))
    path = tmp_path_factory.mktemp("map") / "A.MAP"
    write_maplet(path, maplet)
    file = read_map(path)
    back = file.maplet
    largest = max(1.0, np.nanmax(np.abs(heights), initial=0.0) / gsd)
    assert file.header.hscale == pytest.approx(largest / 30000.0, rel=1e-6)
    np.testing.assert_array_equal(back.valid, maplet.valid)
    quantum = largest / 30000.0 * gsd
    assert np.nanmax(np.abs(back.height - heights), initial=0.0) <= 0.5001 * quantum
    stored = np.clip(albedo, 0.01, 2.55)
    assert np.nanmax(np.abs(back.albedo - stored), initial=0.0) <= 0.0050001
    size = np.linalg.norm(maplet.center_sigma)
    np.testing.assert_allclose(back.center_sigma, maplet.center_sigma, atol=size / 509)
    np.testing.assert_allclose(back.grid.center, maplet.grid.center, rtol=1e-7)
    write_maplet(path, back, header=file.header)
    np.testing.assert_array_equal(read_map(path).maplet.height, back.height)


def test_a_dark_point_is_not_a_missing_point(tmp_path):
    albedo = np.full((3, 3), 0.001)
    albedo[0, 0], albedo[0, 1] = np.nan, 7.0
    write_maplet(tmp_path / "A.MAP", example_maplet(np.zeros((3, 3)), albedo=albedo))
    back = read_map(tmp_path / "A.MAP").maplet
    assert back.valid.all()
    assert back.albedo[1:].min() == back.albedo.min() == 0.01
    assert (back.albedo[0, 0], back.albedo[0, 1]) == (1.0, 2.55)


def test_a_changed_height_takes_a_new_quantum(good, tmp_path):
    file = read_map(good)
    heights = file.maplet.height.copy()
    heights[0, 0] = 500.0  # 1.4e3 GSD: more than 32767 counts of the old quantum
    write_maplet(tmp_path / "A.MAP", file.maplet.with_layers(height=heights), header=file.header)
    back = read_map(tmp_path / "A.MAP")
    assert back.header.hscale == pytest.approx(500.0 / 0.35 / 30000.0, rel=1e-6)
    assert back.header.leading == b"DOUBLE"
    assert back.maplet.height[0, 0] == pytest.approx(500.0, rel=1e-7)


@pytest.mark.parametrize("order", [">", "<"])
def test_sigma_companion(tmp_path, order):
    sigma = np.linspace(0.001, 2.0, 25).reshape(5, 5)
    sigma[2, 3] = np.nan
    maplet = example_maplet(np.zeros((5, 5)), sigma=sigma)
    path = tmp_path / "A.MAP"
    write_maplet(path, maplet, sigma_companion=True)
    if order == "<":
        big = np.frombuffer(sigma_path(path).read_bytes(), ">f4")
        sigma_path(path).write_bytes(big.astype("<f4").tobytes())
    np.testing.assert_allclose(read_maplet(path).sigma, sigma, rtol=1e-7)
    first = np.frombuffer(sigma_path(path).read_bytes(), order + "f4")[1]
    assert first == np.float32(sigma[1, 0] / 1000)  # the fast index runs along Uy: rows


def test_a_sigma_companion_of_another_size_or_unit_is_refused(tmp_path):
    write_sigma(tmp_path / "A.SIG", np.ones((5, 5)))
    with pytest.raises(FormatError, match=r"A\.SIG.*100 bytes, 196 belong to q = 3"):
        read_sigma(tmp_path / "A.SIG", 3)
    (tmp_path / "A.SIG").write_bytes(np.full(25, -1.0, ">f4").tobytes())
    with pytest.raises(FormatError, match=r"A\.SIG.*no sigma in kilometres"):
        read_sigma(tmp_path / "A.SIG", 2)


NAN = struct.pack(">f", np.nan)
BAD_FIELDS = {
    "gsd not a number": ({"gsd": NAN}, "bytes 7-63"),
    "gsd infinite": ({"gsd": struct.pack(">f", np.inf)}, "bytes 7-63"),
    "gsd zero": ({"gsd": bytes(4)}, r"bytes 7-10 \(GSD\)"),
    "gsd negative": ({"gsd": struct.pack(">f", -0.00035)}, r"bytes 7-10 \(GSD\)"),
    "gsd of 200 km": ({"gsd": struct.pack(">f", 200.0)}, r"bytes 7-10 \(GSD\)"),
    "gsd in metres": ({"gsd": struct.pack(">f", 35.0)}, r"\(GSD\).*is it in metres"),
    "gsd byte-swapped": ({"gsd": struct.pack("<f", 0.0005)}, r"\(GSD\).*byte-swapped \(0.0005"),
    "q zero": ({"q": bytes(2)}, r"bytes 11-12 \(q\): q is 0"),
    "q too large": ({"q": struct.pack("<H", 3)}, r"\(q\): q = 3 needs.*truncated"),
    "q too small": ({"q": struct.pack("<H", 1)}, r"\(q\): q = 1 needs.*too long"),
    "q byte-swapped": ({"q": struct.pack(">H", Q)}, r"\(q\): q is byte-swapped: it reads 512"),
    "V not a number": ({"center": NAN + bytes(8)}, "bytes 7-63"),
    "V in metres": ({"center": struct.pack(">3f", 2.5e5, 0, 0)}, r"bytes 16-27 \(V\)"),
    "V byte-swapped": ({"center": struct.pack("<3f", 0.25, -0.125, 0.0625)}, r"\(GSD\)|\(V\)"),
    "axis not a number": ({"axes": struct.pack(">9f", *UX, *UY, 1, np.nan, 0)}, "bytes 7-63"),
    "axis too long": ({"axes": struct.pack(">9f", *UX, *UY, 2, 0, 0)}, r"bytes 28-63"),
    "axes left-handed": ({"axes": struct.pack(">9f", *UY, *UX, *UZ)}, r"bytes 28-63"),
    "hscale zero": ({"hscale": bytes(4)}, r"bytes 64-67 \(hscale\)"),
    "hscale not a number": ({"hscale": NAN}, r"bytes 64-67 \(hscale\)"),
    "hscale absurd": ({"hscale": struct.pack("<f", 1.5 / 30000)}, r"bytes 64-67 \(hscale\)"),
    "sigma negative": ({"size": struct.pack(">f", -1.0)}, r"bytes 68-71"),
    "sigma not a number": ({"size": NAN}, r"bytes 68-71"),
}


@pytest.mark.parametrize("case", BAD_FIELDS)
def test_every_bad_field_is_named(tmp_path, case):
    changes, message = BAD_FIELDS[case]
    path = tmp_path / "BAD.MAP"
    path.write_bytes(map_bytes(**changes))
    with pytest.raises(FormatError, match=message) as caught:
        read_map(path)
    assert "BAD.MAP" in str(caught.value)


CHANGED = {
    "leading": (b"SINGLE", lambda f: f.header.leading),
    "gsd": (struct.pack(">f", 0.0005), lambda f: f.maplet.grid.gsd),
    "direction": (bytes([1, 2, 3]), lambda f: f.maplet.center_sigma.tolist()),
    "center": (struct.pack(">3f", 0.3, 0, 0), lambda f: f.maplet.grid.center.tolist()),
    "axes": (struct.pack(">9f", *UY, *UZ, *UX), lambda f: f.maplet.grid.axes.tolist()),
    "hscale": (struct.pack(">f", 0.001), lambda f: f.maplet.height[0, 0]),
    "size": (struct.pack(">f", 0.004), lambda f: f.maplet.center_sigma.tolist()),
    "version": (struct.pack("b", 3), lambda f: f.header.version),
}


@pytest.mark.parametrize("field", CHANGED)
def test_another_good_value_of_a_field_is_read_and_written(good, tmp_path, field):
    value, get = CHANGED[field]
    path = tmp_path / "B.MAP"
    path.write_bytes(map_bytes(**{field: value}))
    file = read_map(path)
    assert get(file) != get(read_map(good))
    write_maplet(tmp_path / "again.MAP", file.maplet, header=file.header)
    assert (tmp_path / "again.MAP").read_bytes() == path.read_bytes()


def test_every_truncation_is_refused(tmp_path):
    content = map_bytes()
    path = tmp_path / "CUT.MAP"
    for length in range(len(content)):
        path.write_bytes(content[:length])
        with pytest.raises(FormatError, match=r"CUT\.MAP.*(truncated|is empty|q)"):
            read_map(path)
    path.write_bytes(content + b"\0")
    with pytest.raises(FormatError, match="too long"):
        read_map(path)


def test_a_file_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(FormatError, match=r"NONE\.MAP: cannot be read \(No such file"):
        read_map(tmp_path / "NONE.MAP")
    with pytest.raises(FormatError, match="cannot be read"):
        read_map(tmp_path)


def test_what_the_reader_refuses_is_not_written(tmp_path):
    grid = MapletGrid.facing([2.5e8, 0.0, 0.0], [1.0, 0.0, 0.0], 1.0, 1)
    with pytest.raises(InvalidValueError, match=r"V.*more than 100000 km"):
        write_maplet(tmp_path / "A.MAP", Maplet("A", grid, np.zeros((3, 3))))
    with pytest.raises(InvalidValueError, match=r"TEST01: holds a height of 4e\+08 GSD"):
        write_maplet(tmp_path / "A.MAP", example_maplet(np.full((3, 3), 4e5), gsd=0.001))
    with pytest.raises(InvalidValueError, match="6 leading"):
        MapHeader(leading=b"LONGER THAN SIX")
    assert not list(tmp_path.iterdir())
