"""Mapolas on disk: .MAP and mapolas.h5 belong together, whole or not there."""

from __future__ import annotations

import errno
import os
from dataclasses import replace

import h5py
import numpy as np
import pytest

from lidar.formats.mapolas import mapola_names, read_mapola, write_mapolas
from lidar.gridding import Mapola
from spcola.errors import FormatError, InvalidValueError, WorkspaceError
from spcola.formats.map_store import MapStore
from spcola.formats.maplets import read_maplet
from spcola.grids import MapletGrid


def made(name, seed=1):
    rng = np.random.default_rng(seed)
    grid = MapletGrid.facing([230.0, 30.0, -50.0], [1.0, 0.1, -0.2], 0.05, 6)
    count = rng.integers(0, 5, grid.shape)
    height = np.where(count > 0, rng.normal(0, 0.1, grid.shape), np.nan)
    return Mapola(
        name,
        grid,
        height,
        sigma=np.where(count > 0, 0.02, np.nan),
        count=count,
        spread=np.where(count > 2, 0.03, np.nan),
        scan_share={"20190705": 0.25, "20190706": 0.75},
        center_sigma=[0.1, 0.2, 0.3],
    )


def assert_equal(a, b):
    assert a.name == b.name
    for layer in ("height", "sigma", "albedo", "count", "spread", "center_sigma"):
        assert np.array_equal(getattr(a, layer), getattr(b, layer), equal_nan=True), layer
    assert np.array_equal(a.grid.center, b.grid.center)
    assert np.array_equal(a.grid.axes, b.grid.axes)
    assert (a.grid.gsd, a.grid.half_size) == (b.grid.gsd, b.grid.half_size)
    assert a.scan_share == b.scan_share


def test_round_trip_at_full_precision(tmp_path):
    mapolas = [made("AA0001"), made("AA0002", 2)]
    assert write_mapolas(tmp_path, iter(mapolas)) == ["AA0001", "AA0002"]
    assert mapola_names(tmp_path) == ["AA0001", "AA0002"]
    for mapola in mapolas:
        assert_equal(read_mapola(tmp_path, mapola.name), mapola)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["AA0001.MAP", "AA0002.MAP", "mapolas.h5"]


def test_layers_of_one_number_take_no_room(tmp_path):
    mapola = made("AA0001")
    unknown = mapola.with_layers(spread=np.full(mapola.grid.shape, np.nan))
    write_mapolas(tmp_path, [unknown])
    with h5py.File(tmp_path / "mapolas.h5") as file:
        room = {
            layer: file["AA0001"][layer].id.get_storage_size() for layer in ("albedo", "spread")
        }
        assert room == {"albedo": 0, "spread": 0}
        assert file["AA0001/height"].id.get_storage_size() == mapola.height.nbytes
    assert_equal(read_mapola(tmp_path, "AA0001"), unknown)


def test_maps_are_on_the_disk_before_they_take_the_place_of_others(tmp_path, monkeypatch):
    flushed = []
    monkeypatch.setattr(os, "fsync", lambda file: flushed.append((os.fstat(file), there())))

    def there():
        return sorted(path.name for path in tmp_path.glob("*.MAP"))

    write_mapolas(tmp_path, [made("AA0001"), made("AA0002", 2)])
    (first, before), (second, still) = flushed[:2]
    assert before == still == []
    for status, name in ((first, "AA0001.MAP"), (second, "AA0002.MAP")):
        assert os.path.samestat(status, (tmp_path / name).stat())


@pytest.mark.parametrize("shares", [{}, {f"OLA {n}/é": n / 5000 for n in range(5000)}])
def test_shares_of_no_scan_and_of_thousands(tmp_path, shares):
    write_mapolas(tmp_path, [replace(made("AA0001"), scan_share=shares)])
    assert read_mapola(tmp_path, "AA0001").scan_share == shares


def test_the_map_holds_the_heights_to_its_quantum(tmp_path):
    mapola = made("AA0001")
    write_mapolas(tmp_path, [mapola])
    maplet = read_maplet(tmp_path / "AA0001.MAP")
    largest = np.nanmax(np.abs(mapola.height)) / mapola.grid.gsd
    quantum = max(1.0, largest) / 30000 * mapola.grid.gsd
    assert np.array_equal(maplet.valid, mapola.valid)
    # Half a count, and the rounding of the 4-byte header (GSD, hscale) over 30 000 counts.
    assert np.nanmax(np.abs(maplet.height - mapola.height)) < 0.51 * quantum


def test_a_new_set_replaces_the_old_one(tmp_path):
    (tmp_path / "OTHER.MAP").write_bytes(b"somebody's own")
    write_mapolas(tmp_path, [made("AA0001"), made("AA0002")])
    write_mapolas(tmp_path, [made("AA0002", 5), made("AA0003")])
    names = sorted(p.name for p in tmp_path.iterdir())
    assert names == ["AA0002.MAP", "AA0003.MAP", "OTHER.MAP", "mapolas.h5"]
    assert_equal(read_mapola(tmp_path, "AA0002"), made("AA0002", 5))


def test_an_error_in_between_leaves_the_folder_as_it_was(tmp_path):
    write_mapolas(tmp_path, [made("AA0001")])
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def failing():
        yield made("AA0001", 7)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_mapolas(tmp_path, failing())
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_a_full_disk_leaves_the_folder_as_it_was(tmp_path, monkeypatch):
    write_mapolas(tmp_path, [made("AA0001")])
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(MapStore, "_store", full)
    with pytest.raises(WorkspaceError, match=r"mapolas\.h5: cannot be written \(No space left"):
        write_mapolas(tmp_path, [made("AA0001", 8)])
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


@pytest.mark.parametrize("name", ["", "a/b", "../up", ".hidden"])
def test_names_that_are_no_file_names_are_refused(tmp_path, name):
    with pytest.raises(InvalidValueError, match="no name for a file"):
        write_mapolas(tmp_path, [made("GOOD"), made(name)])
    assert list(tmp_path.iterdir()) == []


def test_two_of_one_name_are_refused(tmp_path):
    with pytest.raises(InvalidValueError, match="AA0001: two mapolas have this name"):
        write_mapolas(tmp_path, [made("AA0001"), made("AA0001", 2)])
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_was_removed_is_made_again(tmp_path):
    write_mapolas(tmp_path / "mapolas", [made("AA0001")])
    assert read_mapola(tmp_path / "mapolas", "AA0001").name == "AA0001"


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(WorkspaceError, match="create the folder first"):
        write_mapolas(tmp_path / "absent" / "mapolas", [])
    with pytest.raises(FormatError, match=r"mapolas\.h5: is damaged at AA0001 \(.*No such file"):
        read_mapola(tmp_path, "AA0001")
    write_mapolas(tmp_path, [made("AA0001")])
    with pytest.raises(WorkspaceError, match="holds no mapola AA0009"):
        read_mapola(tmp_path, "AA0009")
    (tmp_path / "AA0001.MAP").unlink()
    with pytest.raises(WorkspaceError, match=r"AA0001\.MAP: cannot be read"):
        read_mapola(tmp_path, "AA0001")


def test_a_changed_map_is_noticed(tmp_path):
    write_mapolas(tmp_path, [made("AA0001")])
    path = tmp_path / "AA0001.MAP"
    path.write_bytes(path.read_bytes()[:-1] + b"\1")
    with pytest.raises(FormatError, match=r"AA0001\.MAP: is not the map"):
        read_mapola(tmp_path, "AA0001")


LAYERS = ["height", "sigma", "albedo", "count", "spread"]
LAYERS += ["scan_share", "scan_share/keys", "scan_share/values"]
ATTRIBUTES = ["center", "axes", "gsd", "half_size", "center_sigma", "map_sha256"]


@pytest.mark.parametrize("part", LAYERS + ATTRIBUTES)
def test_a_part_that_is_gone_is_noticed(tmp_path, part):
    write_mapolas(tmp_path, [made("AA0001")])
    with h5py.File(tmp_path / "mapolas.h5", "r+") as file:
        group = file["AA0001"]
        del (group if part in LAYERS else group.attrs)[part]
    with pytest.raises(FormatError, match=r"mapolas\.h5: is damaged at AA0001"):
        read_mapola(tmp_path, "AA0001")


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("height", np.zeros((3, 3))),
        ("sigma", np.full((13, 13), -1.0)),
        ("count", np.zeros((13, 13))),
        ("scan_share", np.zeros(5)),
        ("scan_share/values", np.zeros(5)),
        ("scan_share/values", [b"half", b"half"]),
        ("scan_share/keys", np.zeros(2)),
        ("axes", np.zeros((3, 3))),
        ("gsd", -1.0),
        ("center", np.full(3, np.nan)),
    ],
)
def test_a_part_that_is_absurd_is_noticed(tmp_path, part, value):
    write_mapolas(tmp_path, [made("AA0001")])
    with h5py.File(tmp_path / "mapolas.h5", "r+") as file:
        holder = file["AA0001"] if part in LAYERS else file["AA0001"].attrs
        del holder[part]
        holder[part] = value
    with pytest.raises(FormatError, match=r"mapolas\.h5: is damaged at AA0001"):
        read_mapola(tmp_path, "AA0001")


@pytest.mark.parametrize("content", [b"", b"text", b"\x89HDF\r\n\x1a\n truncated"])
def test_a_damaged_hdf5_is_named_and_can_be_replaced(tmp_path, content):
    (tmp_path / "mapolas.h5").write_bytes(content)
    with pytest.raises(FormatError, match="make the mapolas again"):
        read_mapola(tmp_path, "AA0001")
    write_mapolas(tmp_path, [made("AA0001")])
    assert_equal(read_mapola(tmp_path, "AA0001"), made("AA0001"))
    with h5py.File(tmp_path / "mapolas.h5", "r+") as file:
        file.attrs["format"] = "something else"
    with pytest.raises(FormatError, match="is an HDF5 file, but not 'spcola mapolas 2'"):
        mapola_names(tmp_path)
