"""ICQ, OBJ and PLY shapes."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spcola.errors import FormatError, InvalidValueError
from spcola.formats.shapes import (
    read_icq,
    read_obj_mesh,
    read_shape,
    recognise_shape,
    write_icq,
    write_obj_mesh,
)
from spcola.formats.shapes.obj import divided
from spcola.formats.shapes.ply import parse_header, read_elements, read_ply_mesh, write_ply_mesh
from spcola.shape import Mesh
from spcola.shape.icq import IcqShape, icq_directions

SPHERE = IcqShape(250.0 * icq_directions(2))

OBJ = """\
# a pyramid
o rock
v -1.0 -1.0 0.0
v 1.0 -1.0 0.0
v 1.0 1.0 0.0
v -1.0 1.0 0.0
v 0.0 0.0 1.5
vn 0 0 1
f 1 4 3 2
f 1 2 5
f 2/7 3/8 5/9
f 3/1/2 4/1/2 5/1/2
f -2//3 -5//3 -1//3
"""
PYRAMID = [[0, 3, 2], [0, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]

PLY = """\
ply
format ascii 1.0
comment a tetrahedron
element vertex 4
property float x
property float y
property float z
property uchar red
element face 3
property list uchar int vertex_index
end_header
0 0 0 10
1 0 0 20
0 1 0 30
0 0 1 40
3 0 2 1
4 0 1 3 2
3 0 3 2
"""


def text_file(tmp_path, text, name):
    path = tmp_path / name
    path.write_text(text)
    return path


def icq_text(shape: IcqShape, tmp_path) -> str:
    write_icq(tmp_path / "icq", shape)
    return (tmp_path / "icq").read_text()


def mesh_dump(mesh: Mesh):
    return mesh.vertices.tolist(), mesh.facets.tolist()


# ICQ


def test_icq_is_read_in_the_order_of_the_file(tmp_path):
    text = icq_text(SPHERE, tmp_path)
    lines = text.splitlines()
    assert lines[0] == "           2"
    assert lines[1] == " -1.44338D-01  1.44338D-01  1.44338D-01"
    shape = read_icq(tmp_path / "icq")
    for f, j, i in [(0, 0, 0), (0, 1, 2), (3, 2, 1), (5, 2, 2)]:
        line = lines[1 + (f * 3 + j) * 3 + i].replace("D", "E")
        expected = [1000.0 * float(number) for number in line.split()]
        np.testing.assert_allclose(shape.vertices[f, j, i], expected, rtol=1e-15)
    assert icq_text(shape, tmp_path) == text


def test_icq_layer_is_the_fourth_column(tmp_path):
    layer = np.linspace(0.5, 1.5, 54).reshape(6, 3, 3)
    write_icq(tmp_path / "A", IcqShape(SPHERE.vertices, layer), digits=12)
    back = read_icq(tmp_path / "A")
    np.testing.assert_allclose(back.layer, layer, rtol=1e-12)
    np.testing.assert_allclose(back.vertices, SPHERE.vertices, rtol=0, atol=1e-9)
    holes = IcqShape(SPHERE.vertices, np.full((6, 3, 3), np.nan))
    with pytest.raises(InvalidValueError, match="layer"):
        write_icq(tmp_path / "A", holes)


def test_every_corrupted_line_of_an_icq_is_seen(every_corruption_is_seen, tmp_path):
    text = icq_text(SPHERE, tmp_path)
    every_corruption_is_seen(text, read_icq, lambda s: s.vertices.tolist(), "X.TXT")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: ["3", *rows[1:]], r"line 55: Q = 3 needs 96 vertices.*truncated"),
        (lambda rows: ["1", *rows[1:]], r"line 55: Q = 1 needs 24 vertices.*too long"),
        (lambda rows: ["2.5", *rows[1:]], r"line 1: Q must be a whole number"),
        (lambda rows: ["0", *rows[1:]], r"line 1: Q must be a whole number"),
        (lambda rows: rows[:1], r"line 1: Q = 2 needs 54 vertices"),
        (lambda rows: [*rows[:5], "0.1 nan 0.1", *rows[6:]], r"line 6: 'nan' is not a number"),
        (lambda rows: [*rows[:5], "0.1 0.1", *rows[6:]], r"line 6: .*needs 3 numbers, not 2"),
        (lambda rows: [*rows[:5], "250. 1. 2.", *rows[6:]], None),
        (lambda rows: [*rows[:5], "2.5D+06 1. 2.", *rows[6:]], r"line 6: .*100000 km"),
        (lambda rows: [*rows[:3], "9. 9. 9.", *rows[4:]], r"line \d+: label .* on line 4"),
    ],
)
def test_what_is_wrong_in_an_icq_is_named(tmp_path, change, message):
    rows = icq_text(SPHERE, tmp_path).splitlines()
    path = text_file(tmp_path, "\n".join(change(rows)), "X.TXT")
    if message is None:  # the middle of a face may be anywhere
        assert read_icq(path).vertices[0, 1, 1].tolist() == [250e3, 1e3, 2e3]
        return
    with pytest.raises(FormatError, match=message):
        read_icq(path)


def test_labels_that_differ_stay_as_they_stand_in_the_file(tmp_path):
    rows = icq_text(SPHERE, tmp_path).splitlines()
    x, y, z = (float(word.replace("D", "E")) for word in rows[1].split())
    rows[1] = f"{1.003 * x:.6f} {1.003 * y:.6f} {1.003 * z:.6f}"
    path = text_file(tmp_path, "\n".join(rows), "X.TXT")
    shape = read_icq(path)
    assert shape.gaps.differing == 2  # a corner: its labels are linked in a row
    assert shape.gaps.max_m == pytest.approx(0.75, rel=1e-3)
    again = tmp_path / "again.TXT"
    write_icq(again, shape, digits=8)
    np.testing.assert_allclose(read_icq(again).vertices, shape.vertices, rtol=1e-8)
    assert "their mean" in read_shape(path).remark
    assert "first label" in read_shape(path, icq_edges="first").remark
    with pytest.raises(InvalidValueError, match="name one vertex differ"):
        read_shape(path, icq_edges="refuse")


def test_faces_that_count_from_0_are_named_and_read_when_asked_for(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 0 2 1\nf 0 1 3\nf 0 3 2\nf -3 -2 -1\n"
    path = text_file(tmp_path, text, "zero.obj")
    with pytest.raises(FormatError, match=r"line 5: .*count from 0.*--faces-from 0"):
        read_obj_mesh(path)
    facets = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    assert read_obj_mesh(path, faces_from=0).facets.tolist() == facets
    assert read_shape(path, faces_from=0).facets.tolist() == facets
    with pytest.raises(FormatError, match="no face names vertex 0"):
        read_obj_mesh(text_file(tmp_path, "v 0 0 0\n" * 4 + "f 1 2 3\n", "one.obj"), faces_from=0)
    with pytest.raises(FormatError, match="names vertex 4, the file has 4"):
        read_obj_mesh(text_file(tmp_path, "v 0 0 0\n" * 4 + "f 0 2 4\n", "far.obj"), faces_from=0)


@pytest.mark.real_data
def test_the_real_shape_of_eros_counts_its_faces_from_0(shared_data):
    mesh = read_obj_mesh(shared_data / "eros" / "eros007790.tab", faces_from=0)
    # Eros: 2503 km³ (Zuber et al. 2000).
    assert mesh.volume == pytest.approx(2503e9, rel=0.01)


@pytest.mark.real_data
def test_the_real_icq_and_obj_are_one_surface_to_the_last_digit(shared_data, tmp_path):
    folder = shared_data / "bennu"
    path = folder / "SHAPE_bennu_ola_v014_q32.TXT"
    shape = read_icq(path)
    write_icq(tmp_path / "again.TXT", shape)
    assert (tmp_path / "again.TXT").read_bytes() == path.read_bytes()
    mesh = read_obj_mesh(folder / "g_12570mm_alt_obj_0000n00000_v014.obj")
    assert mesh.volume == pytest.approx(0.06084014938283392e9, rel=1e-12)
    # Rounded to the digits of the ICQ, the OBJ's vertices are the same text.
    from_obj = IcqShape(mesh.vertices.reshape(6, 33, 33, 3))
    write_icq(tmp_path / "obj.TXT", from_obj)
    assert (tmp_path / "obj.TXT").read_bytes() == path.read_bytes()


@pytest.mark.real_data
def test_the_real_ryugu_shape_is_in_kilometres(shared_data):
    mesh = read_shape(shared_data / "ryugu" / "ryugu_sfm_v20180804_decimated.obj")
    assert (len(mesh.vertices), len(mesh.facets)) == (2976, 5932)
    assert mesh.mean_radius == pytest.approx(448.1, abs=0.5)


# OBJ


def test_all_forms_of_obj_faces(tmp_path):
    mesh = read_obj_mesh(text_file(tmp_path, OBJ, "X.obj"), unit="m")
    np.testing.assert_array_equal(mesh.vertices[4], [0, 0, 1.5])
    assert mesh.facets.tolist() == PYRAMID
    assert mesh.volume == pytest.approx(4.0 * 1.5 / 3.0)
    assert read_obj_mesh(tmp_path / "X.obj").volume == pytest.approx(2.0e9)


def test_line_ends_and_blanks_do_not_matter(tmp_path):
    path = tmp_path / "X.obj"
    path.write_bytes(OBJ.replace("\nv", "\n\t  v").replace("\n", "  \r\n").encode().rstrip())
    assert read_obj_mesh(path).facets.tolist() == PYRAMID


def test_every_corrupted_line_of_an_obj_is_seen(every_corruption_is_seen):
    lines = [line for line in OBJ.splitlines() if line[:2] in ("v ", "f ")]
    text = "\n".join(lines).replace("/7", "").replace("/8", "").replace("/9", "") + "\n"
    every_corruption_is_seen(text, read_obj_mesh, mesh_dump, "X.obj")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("v 1.0 1.0", "w 1.0 1.0", r"line 5: 'w' is no statement"),
        ("v 1.0 1.0 0.0", "v 1.0 1.0", r"line 5: a vertex needs 3 numbers, not 2"),
        ("v 1.0 1.0 0.0", "v 1.0 NaN 0.0", r"line 5: 'NaN' is not a number"),
        ("v 1.0 1.0 0.0", "v 1.0 1e9 0.0", r"line 5: .*100000 km"),
        ("f 1 2 5", "f 1 2", r"line 10: a face needs at least 3"),
        ("f 1 2 5", "f 1 2 6", r"line 10: a face names vertex 6, the file has 5"),
        ("f 1 2 5", "f 1 2 0", r"line 10: a face names vertex 0"),
        ("f 1 2 5", "f 1 2 2.5", r"line 10: a face names vertex 2.5"),
        ("f -2//3", "f -6//3", r"line 13: a face names vertex -6"),
        ("4/1/2", "4/x/2", r"line 12: .*no whole number"),
    ],
)
def test_what_is_wrong_in_an_obj_is_named(tmp_path, old, new, message):
    assert old in OBJ
    with pytest.raises(FormatError, match=message):
        read_obj_mesh(text_file(tmp_path, OBJ.replace(old, new, 1), "X.obj"))


def test_an_obj_without_vertices_or_faces_is_refused(tmp_path):
    with pytest.raises(FormatError, match="holds no vertex"):
        read_obj_mesh(text_file(tmp_path, "# nothing\n", "X.obj"))
    with pytest.raises(FormatError, match="holds no face"):
        read_obj_mesh(text_file(tmp_path, "v 1 2 3\n", "X.obj"))


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-3, 1e6))
def test_written_meshes_are_read_bit_for_bit(tmp_path_factory, seed, scale):
    rng = np.random.default_rng(seed)
    mesh = Mesh(
        scale * rng.normal(size=(7, 3)), rng.permuted(np.arange(7).repeat(3)).reshape(-1, 3)
    )
    folder = tmp_path_factory.mktemp("mesh")
    write_obj_mesh(folder / "A.obj", mesh)
    exact = divided(mesh.vertices, 1000.0) * 1000.0
    back = read_obj_mesh(folder / "A.obj")
    np.testing.assert_array_equal(back.vertices, exact)
    np.testing.assert_allclose(exact, mesh.vertices, rtol=3e-16)
    np.testing.assert_array_equal(back.facets, mesh.facets)
    for encoding in ("ascii", "little", "big"):
        write_ply_mesh(folder / "A.ply", mesh, encoding=encoding, unit="m")
        back = read_ply_mesh(folder / "A.ply", unit="m")
        np.testing.assert_array_equal(back.vertices, mesh.vertices)
        np.testing.assert_array_equal(back.facets, mesh.facets)


# PLY


def read_ply(path, unit="km"):
    """The mesh, and the further numbers of its vertices."""
    mesh, content = read_ply_mesh(path, unit=unit), path.read_bytes()
    vertices = read_elements(content, parse_header(content, path), path)["vertex"]
    return mesh, {name: list(v) for name, v in vertices.items() if name not in ("x", "y", "z")}


def test_ascii_ply_with_layers_and_quads(tmp_path):
    mesh, layers = read_ply(text_file(tmp_path, PLY, "X.ply"), unit="m")
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert mesh.facets.tolist() == [[0, 2, 1], [0, 1, 3], [0, 3, 2], [0, 3, 2]]
    np.testing.assert_array_equal(layers["red"], [10, 20, 30, 40])


@pytest.mark.parametrize(("order", "word"), [("<", "little"), (">", "big")])
def test_binary_ply_built_field_by_field(tmp_path, order, word):
    head = PLY[: PLY.index("end_header") + 11].replace("ascii", f"binary_{word}_endian")
    points = [(0, 0, 0, 10), (1, 0, 0, 20), (0, 1, 0, 30), (0, 0, 1, 40)]
    body = b"".join(struct.pack(f"{order}3fB", *point) for point in points)
    for face in ((0, 2, 1), (0, 1, 3, 2), (0, 3, 2)):
        body += struct.pack(f"{order}B{len(face)}i", len(face), *face)
    path = tmp_path / "X.ply"
    path.write_bytes(head.encode() + body)
    mesh, layers = read_ply(path, unit="m")
    assert mesh.facets.tolist() == [[0, 2, 1], [0, 1, 3], [0, 3, 2], [0, 3, 2]]
    np.testing.assert_array_equal(layers["red"], [10, 20, 30, 40])
    for length in range(len(head) + len(body)):
        path.write_bytes((head.encode() + body)[:length])
        with pytest.raises(FormatError, match=r"X\.ply"):
            read_ply(path)
    path.write_bytes(head.encode() + body + b"\0")
    with pytest.raises(FormatError, match="1 bytes behind the last face"):
        read_ply(path)


def test_every_corrupted_line_of_a_ply_is_seen(every_corruption_is_seen, tmp_path):
    def dump(file):
        return mesh_dump(file[0]), file[1]

    text = PLY.replace("comment a tetrahedron\n", "")
    every_corruption_is_seen(text, read_ply, dump, "X.ply")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ply\n", "plx\n", r"line 1: does not begin with 'ply'"),
        ("ascii 1.0", "ascii 2.0", r"line 2: .*no format of PLY"),
        ("float y", "floot y", r"line 6: .*no property"),
        ("float y", "float x", r"line 6: .*appears twice"),
        ("element face", "element vertex", r"line 9: .*appears twice"),
        ("end_header\n", "", r"line 11: .*no line of a PLY header"),
        ("vertex 4", "vertex 5", r"promises 8 elements, the file has 7"),
        ("float z", "float w", r"x, y and z"),
        ("3 0 2 1\n", "3 0 2 4\n", r"face 0: .*does not exist"),
        ("3 0 2 1\n", "2 0 2\n", r"face 0: has fewer than 3"),
        ("3 0 2 1\n", "3 0 2\n", r"line 16: has too few numbers for a face"),
        ("3 0 2 1\n", "3 0 2 1 0\n", r"line 16: has too many numbers for a face"),
        ("3 0 2 1\n", "2.5 0 2 1\n", r"line 16: vertex_index: 2.5 is no count"),
        ("1 0 0 20", "1 0 nan 20", r"line 13: 'nan' is not a number"),
        ("1 0 0 20", "1 0 1e9 20", r"vertex 1: .*100000 km"),
        ("vertex_index", "corners", r"holds no face; is it a point cloud"),
    ],
)
def test_what_is_wrong_in_a_ply_is_named(tmp_path, old, new, message):
    assert old in PLY
    with pytest.raises(FormatError, match=message):
        read_ply(text_file(tmp_path, PLY.replace(old, new, 1), "X.ply"))


@pytest.mark.parametrize("encoding", ["ascii", "little", "big"])
def test_layers_come_back(tmp_path, encoding):
    mesh = SPHERE.mesh()
    sigma = np.linspace(0.01, 0.5, len(mesh.vertices))
    sigma[3] = 0.1 + 1e-17
    write_ply_mesh(tmp_path / "A.ply", mesh, encoding=encoding, layers={"sigma": sigma})
    found, layers = read_ply(tmp_path / "A.ply")
    np.testing.assert_array_equal(layers["sigma"], sigma)
    np.testing.assert_allclose(found.vertices, mesh.vertices, rtol=3e-16)


def test_layers_that_ply_cannot_hold_are_refused(tmp_path):
    mesh = SPHERE.mesh()
    with pytest.raises(InvalidValueError, match="layer sigma"):
        write_ply_mesh(tmp_path / "A.ply", mesh, layers={"sigma": np.zeros(3)})
    with pytest.raises(InvalidValueError, match="no name"):
        write_ply_mesh(tmp_path / "A.ply", mesh, layers={"x": np.zeros(len(mesh.vertices))})


# Recognition


def test_shapes_are_recognised_by_content(tmp_path):
    icq = text_file(tmp_path, icq_text(SPHERE, tmp_path), "one.dat")
    obj = text_file(tmp_path, OBJ, "two.dat")
    ply = text_file(tmp_path, PLY, "three.dat")
    assert [recognise_shape(path) for path in (icq, obj, ply)] == ["icq", "obj", "ply"]
    assert read_shape(icq).volume == pytest.approx(SPHERE.mesh().volume, rel=1e-4)
    assert read_shape(obj, unit="m").volume == pytest.approx(2.0)
    assert len(read_shape(ply).facets) == 4


@pytest.mark.parametrize("text", ["hello world\n", "1 2 3\n", "\n\n", "# only a comment\n"])
def test_what_is_no_shape_is_refused(tmp_path, text):
    with pytest.raises(FormatError, match=r"X: is no shape.*give ICQ, OBJ or PLY"):
        read_shape(text_file(tmp_path, text, "X"))
