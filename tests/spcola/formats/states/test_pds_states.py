"""States from the geometry in PDS labels: planted ones come back, missing ones are named."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.errors import FormatError
from spcola.formats.images import ImageLabel
from spcola.formats.states import read_pds_state
from spcola.navigation import Spin

TIME = 4.5e8
SPIN = Spin(69.3, 64.1, 114.7, 696.5)
PLACE = np.array([52_000.0, -31_000.0, 28_000.0])
SUN = np.array([0.3, -0.8, 0.52]) / np.linalg.norm([0.3, -0.8, 0.52])
TURN = SPIN.axes([TIME - np.linalg.norm(PLACE) / 299792458.0])[0]


def planted():
    """Axes (3, 3) along J2000 that look at the body, and the keywords of a PDS3 label."""
    looking = Rotation.align_vectors([[0, 0, 1.0]], [-TURN.T @ PLACE])[0]
    axes = (Rotation.from_rotvec([0.01, -0.02, 0.7]) * looking).as_matrix()
    ahead, north = axes[2], np.array([0.0, 0.0, 1.0])
    ra, dec = np.degrees([np.arctan2(ahead[1], ahead[0]), np.arcsin(ahead[2])])
    # From up to the north, clockwise as seen on the display.
    clock = float(np.degrees(np.arctan2(axes[0] @ north, -axes[1] @ north))) % 360.0
    craft_to_sun = TURN.T @ (2.5e11 * SUN - PLACE)
    keywords = {
        "SC_TARGET_POSITION_VECTOR": [f"{x!r} <km>" for x in (-TURN.T @ PLACE / 1e3).tolist()],
        "SC_SUN_POSITION_VECTOR": (craft_to_sun / 1e3).tolist(),
        "RIGHT_ASCENSION": {"value": float(ra) % 360.0, "unit": "deg"},
        "DECLINATION": float(dec),
        "CELESTIAL_NORTH_CLOCK_ANGLE": f"{clock!r} <deg>",
        "TARGET_CENTER_DISTANCE": {"value": np.linalg.norm(PLACE) / 1e3, "unit": "km"},
        "SUB_SPACECRAFT_LATITUDE": float(np.degrees(np.arcsin(PLACE[2] / np.linalg.norm(PLACE)))),
        "SUB_SPACECRAFT_LONGITUDE": float(np.degrees(np.arctan2(PLACE[1], PLACE[0]))) % 360.0,
        "PHASE_ANGLE": float(np.degrees(np.arccos(PLACE @ SUN / np.linalg.norm(PLACE)))),
    }
    return axes, keywords


AXES, KEYWORDS = planted()


def state_of(keywords, form="pds3", spin=SPIN):
    image = SimpleNamespace(
        path="a.img", label_path="a.lbl", format=form, label=ImageLabel(keywords=keywords)
    )
    return read_pds_state(image, "A", TIME, spin)


def check(found, *, axes=AXES, sun_atol=1e-9):
    np.testing.assert_allclose(found.state.position, PLACE, atol=1e-6)
    np.testing.assert_allclose(found.state.axes @ TURN, axes, atol=1e-9)
    np.testing.assert_allclose(found.state.sun, SUN, atol=sun_atol)


def without(*names, **changes):
    return {k: v for k, v in KEYWORDS.items() if k not in names} | changes


def test_a_planted_state_comes_back_from_each_way_to_state_it():
    check(state_of(KEYWORDS))
    assert "SC_TARGET_POSITION_VECTOR read as along J2000" in state_of(KEYWORDS).notes
    twist = (180.0 - float(KEYWORDS["CELESTIAL_NORTH_CLOCK_ANGLE"].split()[0])) % 360.0
    check(state_of({"GROUP": without("CELESTIAL_NORTH_CLOCK_ANGLE", TWIST_ANGLE=twist)}))
    galileo = {"TWIST_ANGLE": twist + 90.0, "TWIST_ANGLE_TYPE": "GALILEO"}
    check(state_of(without("CELESTIAL_NORTH_CLOCK_ANGLE", **galileo)))
    metres = [f"{x!r} <m>" for x in (-TURN.T @ PLACE).tolist()]
    check(state_of(without(SC_TARGET_POSITION_VECTOR=metres)))
    # In the body's frame, against the dictionary: the sub-spacecraft point shows it.
    found = state_of(without(SC_TARGET_POSITION_VECTOR=(-PLACE / 1e3).tolist()))
    check(found)
    assert "SC_TARGET_POSITION_VECTOR read as body-fixed" in found.notes
    point = without("SC_TARGET_POSITION_VECTOR", COORDINATE_SYSTEM_NAME="PLANETOCENTRIC")
    check(state_of(point))
    no_sun = state_of(without("SC_SUN_POSITION_VECTOR"))
    assert np.isnan(no_sun.state.sun).all()


@pytest.mark.parametrize("scalar", [0, 3])
@pytest.mark.parametrize("back", [False, True])
def test_a_quaternion_of_any_convention_is_read_by_its_boresight(scalar, back):
    x, y, z, w = Rotation.from_matrix(AXES.T if back else AXES).as_quat()
    stated = [w, x, y, z] if scalar == 0 else [x, y, z, w]
    found = state_of(without("CELESTIAL_NORTH_CLOCK_ANGLE", QUATERNION=[float(q) for q in stated]))
    check(found)
    how = f"scalar {'last' if scalar else 'first'}, {'to' if back else 'from'} J2000"
    assert any(how in note for note in found.notes)


def test_angles_and_quaternion_of_a_real_label_agree():
    # Dawn VIR, 2015-08-18T08:01:39.684: its description gives w, x, y, z as of SPICE.
    stated = {
        "RIGHT_ASCENSION": "279.965 <degrees>", "DECLINATION": "-62.231 <degrees>",
        "TWIST_ANGLE": "227.917 <degrees>", "CELESTIAL_NORTH_CLOCK_ANGLE": "312.083 <degrees>",
    }  # fmt: skip
    angles = state_of(without("PHASE_ANGLE", **stated))
    quaternion = {"QUATERNION": [0.11612, -0.31567, -0.91802, 0.21]}
    other = without("PHASE_ANGLE", "CELESTIAL_NORTH_CLOCK_ANGLE", **stated, **quaternion)
    other = {k: v for k, v in other.items() if k not in ("TWIST_ANGLE", *list(stated)[3:])}
    turned = state_of(other)
    np.testing.assert_allclose(turned.state.axes, angles.state.axes, atol=3e-5)
    # New Horizons MVIC, 2019-01-01T05:13:44.714: boresight −X, right −Z, down −Y of its instrument.
    mvic = {
        "RIGHT_ASCENSION": 276.8,
        "DECLINATION": -33.8,
        "CELESTIAL_NORTH_CLOCK_ANGLE": 351.57838,
    }
    axes = state_of(without("PHASE_ANGLE", **mvic)).state.axes @ TURN
    q = [0.5793975569923115, 0.3215769780838686, 0.6677051115334547, 0.3391999442067836]
    x, y, z = Rotation.from_quat(q).as_matrix().T
    np.testing.assert_allclose(axes, [-z, -y, -x], atol=1.2e-3)


def vector(name, values, frame=""):
    parts = {
        f"{axis}_position": {"value": repr(float(v)), "unit": "km"}
        for axis, v in zip("xyz", values, strict=True)
    }
    named = {"Reference_Frame_Identification": {"name": frame}} if frame else {}
    return {f"Vector_Cartesian_Position_{name}": {**parts, **named}}


def pds4(vectors):
    orientation = {
        "right_ascension_angle": KEYWORDS["RIGHT_ASCENSION"],
        "declination_angle": {"value": str(KEYWORDS["DECLINATION"]), "unit": "deg"},
        "celestial_north_clock_angle": {
            "value": KEYWORDS["CELESTIAL_NORTH_CLOCK_ANGLE"].split()[0], "unit": "deg",
        },
        "Reference_Frame_Identification": {"name": "EME J2000"},
    }  # fmt: skip
    geometry = {
        "Image_Display_Geometry": {"Object_Orientation_RA_Dec": orientation},
        "Geometry_Orbiter": {"Vectors": {"Vectors_Cartesian_Specific": vectors}},
    }
    return {"Observation_Area": {"Discipline_Area": {"Geometry": geometry}}}


def test_the_geometry_discipline_of_pds4():
    target, sun = -TURN.T @ PLACE / 1e3, TURN.T @ SUN * 2.5e8
    both = vector("Spacecraft_To_Target", target) | vector("Sun_To_Target", -sun)
    check(state_of(pds4(both), "pds4"))
    craft = vector("Spacecraft_To_Target", target) | vector("Sun_To_Spacecraft", -sun - target)
    check(state_of(pds4(craft), "pds4"))
    fixed = vector("Spacecraft_To_Target", -PLACE / 1e3, "IAU_VESTA")
    np.testing.assert_allclose(state_of(pds4(fixed), "pds4").state.position, PLACE, atol=1e-6)
    for vectors, words in (
        (vector("Sun_To_Target", -sun), "geom:Vector_Cartesian_Position_Spacecraft_To_Target"),
        (vector("Spacecraft_To_Target", target, "ECLIPJ2000"), "in the frame 'ECLIPJ2000'"),
    ):
        with pytest.raises(FormatError, match=words):
            state_of(pds4(vectors), "pds4")


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        (without("SC_TARGET_POSITION_VECTOR"), "SC_TARGET_POSITION_VECTOR .or COORDINATE"),
        (without("SC_TARGET_POSITION_VECTOR", "SUB_SPACECRAFT_LATITUDE"), "VECTOR is missing"),
        (without(SC_TARGET_POSITION_VECTOR=["N/A"] * 3), "SC_TARGET_POSITION_VECTOR"),
        (without("RIGHT_ASCENSION"), "RIGHT_ASCENSION and DECLINATION is missing"),
        (without("CELESTIAL_NORTH_CLOCK_ANGLE"), "CELESTIAL_NORTH_CLOCK_ANGLE is missing"),
        (
            without("CELESTIAL_NORTH_CLOCK_ANGLE", QUATERNION=[1.0, 0.0, 0.0, 0.0]),
            "in none of its conventions",
        ),
        (without(TWIST_ANGLE=12.0), "contradict each other"),
        (without(TARGET_CENTER_DISTANCE=66_000.0), "km long"),
        (without(SC_TARGET_POSITION_VECTOR=["1 <AU>"] * 3), "unit 'au'"),
        (
            without(SC_TARGET_POSITION_VECTOR=(TURN.T @ PLACE / 1e3).tolist()),
            "from the point under it",
        ),
        (
            without(SC_SUN_POSITION_VECTOR=(-TURN.T @ SUN * 2.5e8).tolist()),
            "phase angle",
        ),
    ],
)
def test_what_is_missing_or_contradicts_itself_is_named(keywords, words):
    with pytest.raises(FormatError, match=words):
        state_of(keywords)


def test_vectors_along_j2000_need_the_rotation():
    with pytest.raises(FormatError, match="give --pck"):
        state_of(KEYWORDS, spin=None)
