"""Output of `spcola info` and `spcola init` on shapes, lidar and other files."""

from __future__ import annotations

import gzip
import json
import re
import zipfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from command_line import app
from PIL import Image
from typer.testing import CliRunner

from fusion.workspace import Workspace
from spcola.formats.shapes import write_icq, write_obj_mesh
from spcola.shape.icq import IcqShape, icq_directions


def call(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    if code:
        assert result.stderr.count("\n") == 1
    return result.stderr if code else result.stdout


def facts(*arguments: object) -> Any:
    return json.loads(call("info", *arguments, "--json"))


def image(path: Path, form: str) -> None:
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(path, format=form)


def packed(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a", "b")


def hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["a"] = 1.0


FOREIGN = {
    "PNG": (lambda path: image(path, "PNG"), "is a PNG image; .*spcola images WS FILE"),
    "JPEG": (lambda path: image(path, "JPEG"), "is a JPEG image"),
    "TIFF": (lambda path: image(path, "TIFF"), "is a TIFF; .*spcola images.*ends in .tif"),
    "GIF": (lambda path: image(path, "GIF"), "is a GIF image; .*convert it to TIFF or FITS"),
    "ZIP": (packed, "is a ZIP archive; unpack it first"),
    "gzip": (lambda path: path.write_bytes(gzip.compress(b"v 1 2 3")), "is a gzip file; unpack"),
    "HDF5": (hdf5, "is an HDF5 file, but not"),
    "NPY": (lambda path: path.write_bytes(b"\x93NUMPY\x01\0v\0"), "is a NumPy array"),
    "SQLite": (lambda path: path.write_bytes(b"SQLite format 3\0"), "is an SQLite database"),
    "PDF": (lambda path: path.write_bytes(b"%PDF-1.7\n"), "is a PDF document"),
    "DSK": (lambda path: path.write_bytes(b"DAS/DSK \0\0"), "is a SPICE DSK"),
    "old kernel": (lambda path: path.write_bytes(b"NAIF/DAF\0"), "before 1996"),
    "FITS": (
        lambda path: path.write_text("SIMPLE  =                    T"),
        "a FITS file; .*spcola images",
    ),
    "PDS3": (
        lambda path: path.write_text("PDS_VERSION_ID = PDS3\n"),
        "PDS3.*spcola images",
    ),
    "VICAR": (
        lambda path: path.write_text("LBLSIZE=1024 FORMAT='BYTE'"),
        "a VICAR image; .*PDS label",
    ),
    "PVL": (lambda path: path.write_text("Object = Network\n  A = 1\n"), "label or settings"),
    "cube": (
        lambda path: path.write_bytes(b"Object = IsisCube\n\0\0"),
        "ISIS cube; .*images WS",
    ),
    "cube's label": (lambda path: path.write_text("Object = IsisCube\n"), "label of an ISIS cube"),
    "PDS4": (
        lambda path: path.write_text('<?xml version="1.0"?><P xmlns="http://pds.nasa.gov/pds4/">'),
        "is a PDS4 label",
    ),
    "XML": (lambda path: path.write_text("<?xml version='1.0'?><a/>"), "is XML"),
    "HTML": (lambda path: path.write_text("<!DOCTYPE html><html>"), "is an HTML page"),
    "JSON": (lambda path: path.write_text('{"a": 1}'), "is JSON"),
    "BOM": (lambda path: path.write_bytes(b"\xef\xbb\xbf[1, 2]"), "is JSON"),
    "text": (lambda path: path.write_text("Hello, world"), "is text in no format.*spcola import"),
    "binary": (lambda path: path.write_bytes(bytes(range(256))), "is binary data in no format"),
    "empty": (lambda path: path.write_bytes(b""), "is empty"),
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_what_is_none_of_the_formats_is_named(tmp_path: Path, kind: str) -> None:
    write, words = FOREIGN[kind]
    path = tmp_path / "file.dat"
    write(path)
    line = call("info", path, code=1)
    assert "file.dat" in line
    assert re.search(words, line), line
    assert "name its format" not in line


def test_what_stages_write_is_named_with_its_workspace(tmp_path: Path) -> None:
    for name in ("mapolas.h5", "fused.h5", "adjustment.h5"):
        hdf5(tmp_path / name)
        line = call("info", tmp_path / name, code=1)
        assert "is a result of a workspace; name the workspace" in line


def apart(q: int) -> IcqShape:
    """A shape with one label 0.9 m off its vertex."""
    vertices = np.ascontiguousarray(290.0 * icq_directions(q))
    vertices[0, q, 1] *= 1.0 + 0.9 / 290.0
    return IcqShape(vertices)


def test_info_gives_q_and_how_the_edges_of_an_icq_close(tmp_path: Path) -> None:
    write_icq(tmp_path / "A.TXT", apart(8))
    found = facts(tmp_path / "A.TXT")
    assert (found["icq_q"], found["icq_labels_shared"], found["icq_labels_differing"]) == (
        8,
        108,
        1,
    )
    assert found["icq_differ_max_m"] == pytest.approx(0.9, rel=0.02)
    write_obj_mesh(tmp_path / "a.obj", apart(8).mesh(distinct=False))
    assert facts(tmp_path / "a.obj")["icq_q"] == 8
    write_obj_mesh(tmp_path / "b.obj", apart(8).mesh())
    assert "icq_q" not in facts(tmp_path / "b.obj")


@pytest.mark.real_data
def test_info_knows_the_real_obj_in_the_order_of_an_icq(shared_data: Path) -> None:
    found = facts(shared_data / "bennu" / "g_12570mm_alt_obj_0000n00000_v014.obj")
    assert (found["icq_q"], found["icq_labels_differing"]) == (32, 0)


def test_init_reports_edges_that_differ(tmp_path: Path) -> None:
    write_icq(tmp_path / "A.TXT", apart(8))
    printed = call("init", tmp_path / "WS", "--shape", tmp_path / "A.TXT")
    assert "1 of 108 pairs of labels that name one vertex differ, by up to 0.90" in printed
    assert "each such vertex is put at their mean" in printed
    workspace = Workspace.open(tmp_path / "WS")
    assert "their mean" in workspace.shape().remark
    settings = tmp_path / "WS" / "spcola.toml"
    text = settings.read_text(encoding="utf-8")
    settings.write_text(text.replace('icq_edges = "mean"', 'icq_edges = "first"'))
    assert "its first label" in workspace.shape().remark


def test_faces_numbered_from_0_are_read_with_the_option(tmp_path: Path) -> None:
    path = tmp_path / "zero.obj"
    path.write_text(
        "v 1 1 1\nv -1 -1 1\nv -1 1 -1\nv 1 -1 -1\nf 0 2 1\nf 0 1 3\nf 0 3 2\nf 1 2 3\n"
    )
    assert "--faces-from 0" in call("info", path, code=1)
    assert facts(path, "--faces-from", 0)["volume_m3"] == pytest.approx(8e9 / 3)
    assert "--faces-from 0" in call("init", tmp_path / "WS", "--shape", path, code=1)
    call("init", tmp_path / "WS", "--shape", path, "--faces-from", 0)
    workspace = Workspace.open(tmp_path / "WS")
    assert workspace.settings().body.faces_from == 0
    assert workspace.shape().volume == pytest.approx(8e9 / 3)


@pytest.mark.real_data
def test_info_gives_the_unit_of_a_las_file(shared_data: Path) -> None:
    found = facts(shared_data / "pointcloud" / "autzen_trim.laz")
    assert (found["coordinate_kind"], found["unit_m"]) == ("projected", 0.3048)
    plain = facts(shared_data / "pointcloud" / "simple.las")
    assert (plain["coordinate_system"], plain["unit_m"]) == ("not stated", None)
