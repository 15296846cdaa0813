"""The folder of fused maplets: bit for bit, all or nothing, and no map mixed up."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from fusion.fusing.maplets import FUSED_HDF5, fused_names, read_fused, write_fused
from spcola.errors import FormatError, InvalidValueError, WorkspaceError
from spcola.formats.maplets import read_maplet


def test_reads_back_to_the_last_bit(tmp_path, make_fused, assert_same) -> None:
    maplets = [make_fused("BB0002", 12, 1), make_fused("AA0001", 30, 2)]
    assert write_fused(tmp_path, iter(maplets)) == ["BB0002", "AA0001"]
    assert fused_names(tmp_path) == ["AA0001", "BB0002"]
    for maplet in maplets:
        assert_same(read_fused(tmp_path, maplet.name), maplet)


def test_map_and_sigma_serve_spc_programs(tmp_path, fused) -> None:
    write_fused(tmp_path, [fused], sigma_companions=True)
    plain = read_maplet(tmp_path / "BE0042.MAP")
    np.testing.assert_array_equal(plain.valid, fused.valid)
    np.testing.assert_allclose(plain.sigma, fused.sigma, rtol=1e-6)
    quantum = max(fused.grid.gsd, np.nanmax(np.abs(fused.height))) / 30000
    np.testing.assert_allclose(plain.height, fused.height, atol=0.51 * quantum)


def test_same_input_gives_same_bytes(tmp_path, fused) -> None:
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        write_fused(tmp_path / folder, [fused], sigma_companions=True)
    for name in (FUSED_HDF5, "BE0042.MAP", "BE0042.SIG"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_what_is_no_longer_made_goes_and_the_rest_stays(tmp_path, make_fused) -> None:
    write_fused(tmp_path, [make_fused("AA0001", 5), make_fused("BB0002", 5)], sigma_companions=True)
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    write_fused(tmp_path, [make_fused("BB0002", 5)], sigma_companions=True)
    kept = sorted(path.name for path in tmp_path.iterdir())
    assert kept == ["BB0002.MAP", "BB0002.SIG", FUSED_HDF5, "notes.txt"]


def test_an_error_leaves_the_folder_as_it_was(tmp_path, make_fused, assert_same) -> None:
    first = make_fused("AA0001", 5)
    write_fused(tmp_path, [first])
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def failing():
        yield make_fused("AA0001", 5, seed=9)
        raise OSError(28, "No space left on device")

    with pytest.raises(WorkspaceError, match="No space left"):
        write_fused(tmp_path, failing())
    with pytest.raises(InvalidValueError, match="have this name"):
        write_fused(tmp_path, [first, first])
    for name in ("", "../AA0001"):
        with pytest.raises(InvalidValueError, match="no name for a file"):
            write_fused(tmp_path, [make_fused(name, 5)])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_each_part_corrupted_once(tmp_path, fused) -> None:
    write_fused(tmp_path, [fused])
    path = tmp_path / FUSED_HDF5
    whole = path.read_bytes()
    with pytest.raises(WorkspaceError, match="no fused maplet ZZ9999"):
        read_fused(tmp_path, "ZZ9999")
    for layer in ("height", "sigma", "albedo", "count", "source"):
        with h5py.File(path, "r+") as file:
            del file["BE0042"][layer]
        with pytest.raises(FormatError, match="damaged at BE0042"):
            read_fused(tmp_path, "BE0042")
        path.write_bytes(whole)
    for key in ("center", "axes", "gsd", "half_size", "center_sigma", "map_sha256"):
        with h5py.File(path, "r+") as file:
            del file["BE0042"].attrs[key]
        with pytest.raises(FormatError, match="damaged at BE0042"):
            read_fused(tmp_path, "BE0042")
        path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = "spcola mapolas 2"
    with pytest.raises(FormatError, match="is an HDF5 file, but not 'spcola fused maplets 1'"):
        fused_names(tmp_path)
    path.write_bytes(whole[: len(whole) // 3])
    with pytest.raises(FormatError, match="is damaged"):
        read_fused(tmp_path, "BE0042")


def test_a_map_changed_by_hand_is_noticed(tmp_path, fused) -> None:
    write_fused(tmp_path, [fused])
    path = tmp_path / "BE0042.MAP"
    content = bytearray(path.read_bytes())
    content[100] ^= 1
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"not the map that fused\.h5 describes"):
        read_fused(tmp_path, "BE0042")
    path.unlink()
    with pytest.raises(WorkspaceError, match="cannot be read"):
        read_fused(tmp_path, "BE0042")
