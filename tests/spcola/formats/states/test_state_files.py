"""Files with states of images: what was planted is read, and damage is named."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.errors import FormatError
from spcola.formats.states import read_colmap, read_isd_states, read_poses
from spcola.formats.states.isis import isis_states
from spcola.navigation import Spin, et_from_utc
from spcola.navigation.states import StateSource

SPIN = Spin(85.6, -60.2, 150.0, 2011.15)
UTC = "2018-11-08T04:14:47.131"
TIME = et_from_utc(UTC)
TURN = SPIN.axes([TIME])[0]
AXES = Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix()
V0 = AXES.T @ np.array([20.0, -10.0, 4000.0])
SUN = np.array([0.6, 0.0, 0.8])


def quaternion(matrix):
    return Rotation.from_matrix(matrix).as_quat()[[3, 0, 1, 2]]


def table_of(path, columns, rows=None):
    lines = [",".join(columns), *(",".join(map(str, row)) for row in rows or [columns.values()])]
    path.write_text("\n".join(lines) + "\n")
    return path


def listed(names, values):
    return dict(zip(names.split(), np.ravel(values).tolist(), strict=True))


POSITIONS = {
    "V0 in km": listed("v0x_km v0y_km v0z_km", V0 / 1000.0),
    "spacecraft in m": listed("scx_m scy_m scz_m", -V0),
    "spacecraft along J2000": listed("scx_km_j2000 scy_km_j2000 scz_km_j2000", -TURN.T @ V0 / 1e3),
}
ROWS = "cxx cxy cxz cyx cyy cyz czx czy czz"
ATTITUDES = {
    "axes": listed(ROWS, AXES),
    "axes along J2000": listed(" ".join(f"{c}_j2000" for c in ROWS.split()), AXES @ TURN),
    "quaternion": listed("qw qx qy qz", quaternion(AXES)),
    "quaternion of J2000": listed("qw_j2000 qx_j2000 qy_j2000 qz_j2000", quaternion(AXES @ TURN)),
}


def celestial():
    boresight = (AXES @ TURN)[2]
    ra, dec = np.arctan2(boresight[1], boresight[0]), np.arcsin(boresight[2])
    untwisted = Rotation.from_euler("ZXZ", [np.pi / 2 + ra, np.pi / 2 - dec, 0.0]).as_matrix().T
    twist = np.arctan2((AXES @ TURN)[0] @ untwisted[1], (AXES @ TURN)[0] @ untwisted[0])
    return listed("ra_deg dec_deg twist_deg", np.degrees([ra, dec, twist]))


@pytest.mark.parametrize("position", POSITIONS)
@pytest.mark.parametrize("attitude", [*ATTITUDES, "celestial"])
def test_a_table_gives_the_state_in_every_form(tmp_path, position, attitude):
    columns = {"image": "P1", "utc": UTC, **POSITIONS[position], **listed("sunx suny sunz", SUN)}
    columns |= celestial() if attitude == "celestial" else ATTITUDES[attitude]
    state = read_poses(table_of(tmp_path / "poses.csv", columns), spin=SPIN)["P1"].only()
    assert (state.name, state.time, state.source) == ("P1", TIME, StateSource.POSES)
    np.testing.assert_allclose(state.scobj, V0, atol=1e-6)
    np.testing.assert_allclose(state.axes, AXES, atol=1e-9)
    np.testing.assert_allclose(state.sun, SUN, atol=1e-9)
    assert np.isnan(state.scobj_sigma).all()


def plain_columns():
    return {"image": "P1", "et": TIME, **POSITIONS["V0 in km"], **ATTITUDES["axes"]}


def test_declared_columns_and_sigmas(tmp_path):
    columns = plain_columns() | listed("sigma_v0x_m sigma_v0y_m sigma_v0z_m", [1.0, 2.0, 3.0])
    columns |= listed("sigma_cx_rad sigma_cy_rad sigma_cz_rad", [1e-5, 2e-5, 3e-5])
    columns = {
        {"v0x_km": "X [km]", "image": "Picture name"}.get(k, k): v for k, v in columns.items()
    }
    path = table_of(tmp_path / "poses.csv", columns)
    with pytest.raises(FormatError, match="names no image"):
        read_poses(path)
    state = read_poses(path, columns={"v0x_km": "X [km]", "image": "Picture name"})["P1"].only()
    np.testing.assert_allclose(state.scobj, V0)
    np.testing.assert_allclose(state.scobj_sigma, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(state.pointing_sigma, [1e-5, 2e-5, 3e-5])
    assert np.isnan(state.sun).all()


def test_semicolons_blank_lines_and_a_byte_order_mark(tmp_path):
    path = table_of(tmp_path / "poses.csv", plain_columns())
    text = path.read_text().replace(",", ";") + "\n"
    path.write_text("\ufeff" + text, encoding="utf-8")
    assert list(read_poses(path)) == ["P1"]


WRONG = {
    "no attitude": (lambda c: [c.pop(k) for k in ROWS.split()], "states no attitude"),
    "two attitudes": (lambda c: c.update(ATTITUDES["quaternion"]), "or two"),
    "no position": (lambda c: [c.pop(f"v0{k}_km") for k in "xyz"], "states no position"),
    "two units": (lambda c: c.update(listed("v0x_m v0y_m v0z_m", V0)), "twice"),
    "half a vector": (lambda c: c.pop("v0z_km"), "no column v0z_km"),
    "a word": (lambda c: c.update(v0x_km="far"), "not a number"),
    "infinity": (lambda c: c.update(v0x_km="inf"), "not a number"),
    "no time of J2000": (
        lambda c: (c.pop("et"), c.pop("cxx"), c.update(celestial())) and [
            c.pop(k) for k in ROWS.split() if k in c
        ],
        "the time is not stated",
    ),
    "left-handed": (lambda c: c.update(listed("cxx cxy cxz", -AXES[0])), "left-handed"),
    "no date": (lambda c: (c.pop("et"), c.update(utc="yesterday noonish")), "is not a time"),
    "zero Sun": (lambda c: c.update(sunx=0, suny=0, sunz=0), "zero"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_table_is_refused_with_its_line(tmp_path, case):
    change, text = WRONG[case]
    columns = plain_columns()
    change(columns)
    with pytest.raises(FormatError, match=text) as caught:
        read_poses(table_of(tmp_path / "poses.csv", columns), spin=SPIN)
    assert "line 2" in str(caught.value)


def test_a_table_along_j2000_needs_a_rotation(tmp_path):
    columns = {"image": "P1", "et": TIME, **POSITIONS["V0 in km"], **celestial()}
    with pytest.raises(FormatError, match="the rotation of the body is not stated"):
        read_poses(table_of(tmp_path / "poses.csv", columns))


def test_an_image_twice_and_ragged_lines(tmp_path):
    columns = plain_columns()
    row = list(columns.values())
    with pytest.raises(FormatError, match="line 3: P1 appears twice"):
        read_poses(table_of(tmp_path / "a.csv", columns, [row, row]))["P1"].only()
    with pytest.raises(FormatError, match="13 values for 14"):
        read_poses(table_of(tmp_path / "b.csv", columns, [row[:-1]]))
    with pytest.raises(FormatError, match="no header and rows"):
        read_poses(table_of(tmp_path / "c.csv", columns, [[""] * len(row)]))


def test_files_that_are_no_tables(tmp_path):
    path = tmp_path / "poses.csv"
    for content in (
        b"\n\n",
        b"\0\1\2",
        b"image\n" + b"x" * 200_000,
        b"a,a\n1,2\n",
        b"\xff\xfe,x\n1,2",
    ):
        path.write_bytes(content)
        with pytest.raises(FormatError, match=r"poses\.csv"):
            read_poses(path)


def make_isd():
    rotated = {"ephemeris_times": [TIME], "reference_frame": 1}
    return {
        "instrument_pointing": rotated | {"quaternions": [quaternion(AXES @ TURN).tolist()]},
        "body_rotation": rotated
        | {
            "quaternions": [quaternion(np.eye(3)).tolist()],
            "constant_rotation": TURN.ravel().tolist(),
        },
        "instrument_position": rotated
        | {"positions": [(-TURN.T @ V0 / 1e3).tolist()], "velocities": [[0.001, 0.0, 0.0]]},
        "sun_position": rotated | {"positions": [(1e8 * TURN.T @ SUN).tolist()]},
    }


def test_an_isd_gives_the_state(tmp_path):
    path = tmp_path / "image.isd"
    path.write_text(json.dumps(make_isd()))
    state = read_isd_states(path).state("P1")
    assert state.source is StateSource.ISD
    np.testing.assert_allclose(state.scobj, V0, atol=1e-6)
    np.testing.assert_allclose(state.axes, AXES, atol=1e-9)
    np.testing.assert_allclose(state.sun, SUN, atol=1e-9)
    np.testing.assert_allclose(state.velocity, TURN[:, 0], atol=1e-9)


def change_isd(table, **changed):
    content = make_isd()
    content[table].update(changed)
    return content


WRONG_ISD = {
    "no table": ({"sensor_position": {}}, "instrument_pointing: is missing"),
    "a list": ([1, 2], "no JSON object"),
    "a frame": (
        change_isd("instrument_position", reference_frame=31001),
        "is 31001, not J2000",
    ),
    "metres": (change_isd("instrument_position", unit="m"), "is in m, not in km"),
    "too large": (
        change_isd("instrument_position", positions=[[10**400, 0, 0]]),
        "no usable number",
    ),
    "a word": (change_isd("body_rotation", quaternions="none"), "missing or no list"),
    "length": (change_isd("body_rotation", quaternions=[[2, 0, 0, 0]]), "unit length"),
    "rows": (change_isd("instrument_position", ephemeris_times=[1.0, 2.0]), "1 rows for 2 times"),
    "no mirror": (change_isd("body_rotation", constant_rotation=(-TURN).ravel().tolist()), "left"),
}


@pytest.mark.parametrize("case", WRONG_ISD)
def test_a_wrong_isd_is_refused(tmp_path, case):
    content, text = WRONG_ISD[case]
    path = tmp_path / "image.isd"
    path.write_text(json.dumps(content))
    with pytest.raises(FormatError, match=text) as caught:
        read_isd_states(path)
    assert "image.isd" in str(caught.value)


def test_an_isd_that_is_cut_off_is_refused(tmp_path):
    path = tmp_path / "image.isd"
    path.write_text(json.dumps(make_isd())[:100])
    with pytest.raises(FormatError, match="is not JSON"):
        read_isd_states(path)


@dataclass
class Table:
    keywords: dict
    columns: dict


def cube_tables():
    def columns(names, values):
        return {"ET": np.array([TIME])} | {
            name: np.array([value]) for name, value in zip(names.split(), values, strict=True)
        }

    turned = "J2000Q0 J2000Q1 J2000Q2 J2000Q3"
    placed = "J2000X J2000Y J2000Z J2000XV J2000YV J2000ZV"
    constant = {"ConstantRotation": TURN.ravel().tolist()}
    place = np.concatenate([-TURN.T @ V0 / 1e3, [0.001, 0.0, 0.0]])
    sun = np.concatenate([1e8 * TURN.T @ SUN, np.zeros(3)])
    return {
        "InstrumentPointing": Table({}, columns(turned, quaternion(AXES @ TURN))),
        "BodyRotation": Table(constant, columns(turned, [1.0, 0.0, 0.0, 0.0])),
        "InstrumentPosition": Table({}, columns(placed, place)),
        "SunPosition": Table({}, columns(placed, sun)),
    }


def test_tables_of_a_cube_give_the_state():
    state = isis_states(cube_tables(), "x.cub").state("P1")
    assert state.source is StateSource.ISIS
    np.testing.assert_allclose(state.scobj, V0, atol=1e-6)
    np.testing.assert_allclose(state.axes, AXES, atol=1e-9)
    np.testing.assert_allclose(state.sun, SUN, atol=1e-9)
    np.testing.assert_allclose(state.velocity, TURN[:, 0], atol=1e-9)


def test_cubes_without_tables_or_with_polynomials_are_refused():
    tables = cube_tables()
    del tables["InstrumentPointing"].columns["J2000Q0"]
    with pytest.raises(FormatError, match="no column J2000Q0"):
        isis_states(tables, "x.cub")
    tables = cube_tables()
    tables["BodyRotation"].keywords["ConstantRotation"] = [1.0, 0.0]
    with pytest.raises(FormatError, match="2 numbers, not 9"):
        isis_states(tables, "x.cub")
    del tables["InstrumentPosition"]
    with pytest.raises(FormatError, match="run spiceinit"):
        isis_states(tables, "x.cub")


def write_model(folder, names, *, text=False):
    pose = [*quaternion(AXES), *(AXES @ V0 / 1e3)]
    if text:
        lines = ["# comment"]
        for number, name in enumerate(names):
            lines += [f"{number} {' '.join(map(repr, map(float, pose)))} 7 {name}", "1.0 2.0 -1"]
        (folder / "images.txt").write_text("\n".join(lines) + "\n")
        return
    content = struct.pack("<Q", len(names))
    for number, name in enumerate(names):
        content += struct.pack("<I7dI", number, *pose, 7) + name.encode() + b"\0"
        content += struct.pack("<Q", 1) + struct.pack("<2dq", 1.0, 2.0, -1)
    (folder / "images.bin").write_bytes(content)


@pytest.mark.parametrize("text", [False, True])
def test_a_colmap_model_gives_the_states(tmp_path, text):
    write_model(tmp_path, ["b.png", "a.png"], text=text)
    (state, camera), (second, _) = read_colmap(tmp_path, unit="km")
    assert (state.name, second.name) == ("a.png", "b.png")
    np.testing.assert_allclose(state.scobj, V0, atol=1e-8)
    np.testing.assert_allclose(state.axes, AXES, atol=1e-12)
    assert np.isnan(state.time)
    assert camera == 7


def test_damaged_colmap_models_are_refused(tmp_path):
    write_model(tmp_path, ["a.png"])
    whole = (tmp_path / "images.bin").read_bytes()
    for size in (8, 60, 70, 80, len(whole) - 1):
        (tmp_path / "images.bin").write_bytes(whole[:size])
        with pytest.raises(FormatError, match="ends"):
            read_colmap(tmp_path, unit="km")
    (tmp_path / "images.bin").write_bytes(whole[:12] + struct.pack("<d", 3.0) + whole[20:])
    with pytest.raises(FormatError, match="the length"):
        read_colmap(tmp_path, unit="km")


def test_a_line_of_colmap_text_that_is_none_is_named(tmp_path):
    write_model(tmp_path, ["a.png"], text=True)
    (tmp_path / "images.txt").write_text("1 0.5 0.5 0.5 0.5 1 2 far 7 a.png\n\n")
    with pytest.raises(FormatError, match="line 1: is no line of COLMAP"):
        read_colmap(tmp_path, unit="m")
