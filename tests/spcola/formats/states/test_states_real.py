"""States in real files: control points and footprints fall on the pixels that their files state."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from spcola.formats.states import read_colmap, read_isd_states, read_isis_states, read_poses
from spcola.navigation import Spin, et_from_utc
from spcola.navigation.states import compare_states

pytestmark = pytest.mark.real_data
MOON = 1_737_400.0
# Apollo's metric camera by its kernel: mm, and the coefficients of its distortion.
FOCAL, CENTER = 76.054, np.array([-0.006, -0.002])
RADIAL = (-1.3361854e-06, 5.2261757e-10, -5.0728336e-14)
DECENTER = (-5.4958195e-07, -4.608942e-11, 2.965907)


def on_sphere(latitude, longitude, radius):
    lat, lon = np.radians(latitude), np.radians(longitude)
    east = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    return np.asarray(radius)[..., None] * east


def true_place(x, y):
    """Of Apollo's measured x, y, mm: without the distortion."""
    dx, dy = x - CENTER[0], y - CENTER[1]
    r2 = dx * dx + dy * dy
    radial = 1.0 + r2 * (RADIAL[0] + r2 * (RADIAL[1] + r2 * RADIAL[2]))
    aside = (DECENTER[0] + DECENTER[1] * r2) * r2
    return dx * radial - aside * np.sin(DECENTER[2]), dy * radial + aside * np.cos(DECENTER[2])


def apollo_film(state, points):
    """Sample and line on the film (22900 × 22900 pixels of 5 µm) of points (N, 3)."""
    seen = (points + state.scobj) @ state.axes.T
    # Cy is turned: the camera looks along −Z of its frame.
    wanted = FOCAL * seen[:, :2] / seen[:, 2:] * [1.0, -1.0]
    x, y = (wanted + CENTER).T
    for _ in range(60):
        true = true_place(x, y)
        x, y = x + wanted[:, 0] - true[0], y + wanted[:, 1] - true[1]
    return np.stack([11450.0 - 200.0 * x, 11450.0 + 200.0 * y], axis=1)


def cube_text(path):
    return path.read_bytes()[:65536].decode("latin-1")


def corners_of(path):
    """Longitude and latitude (4, 2) of a footprint's corners: its ring has five steps a side."""
    label = cube_text(path)
    words = r"Object = Polygon\s+Name\s+= Footprint\s+StartByte = (\d+)\s+Bytes\s+= (\d+)"
    place = re.search(words, label)
    begin, size = (int(group) for group in place.groups())
    text = path.read_bytes()[begin - 1 : begin - 1 + size].decode("ascii")
    ring = re.search(r"\(\(\((.*?)\)\)\)", text)[1]
    return np.array([[float(word) for word in point.split()] for point in ring.split(",")])[:20:5]


@pytest.mark.parametrize("number", [297, 298, 299])
def test_corners_of_apollo_footprints_fall_on_the_corners_of_the_image(shared_data, number):
    path = shared_data / "apollo15" / f"AS15-M-0{number}_crop.cub"
    tables = read_isis_states(path)
    assert tables.backward
    state = tables.state("crop")
    label = cube_text(path)
    item = {
        name: float(re.search(rf"{name}\s*= ([\d.]+)", label)[1])
        for name in ("AlphaStartingSample", "AlphaStartingLine", "AlphaEndingSample")
    }
    scale = 500.0 / (item["AlphaEndingSample"] - item["AlphaStartingSample"])
    start = np.array([item["AlphaStartingSample"], item["AlphaStartingLine"]])
    lon, lat = corners_of(path).T
    places = [
        (apollo_film(state, on_sphere(lat, lon, np.full(4, MOON + height))) - start) * scale + 0.5
        for height in (0.0, 1000.0)
    ]
    # The label used heights of LOLA: each corner may lie on its line of changing height.
    expected = np.array([[0.5, 0.5], [500.5, 0.5], [500.5, 500.5], [0.5, 500.5]])
    step = places[1] - places[0]
    across = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.linalg.norm(step, axis=1)[:, None]
    assert np.abs(((expected - places[0]) * across).sum(axis=1)).max() < 0.01
    heights = ((expected - places[0]) * step).sum(axis=1) / (step * step).sum(axis=1)
    assert np.abs(heights).max() < 8.0


@pytest.mark.parametrize(
    ("name", "start", "low", "high", "off_deg"),
    [
        ("20200303T213031S138_ncm_L0-reduced.cub", "2020-03-03T21:30:31.113", 460.0, 480.0, 7.0),
        ("M143947267L.cal.echo.crop.cub", "2010-11-09T13:06:46.375", 1.78e6, 1.80e6, 10.0),
    ],
)
def test_other_cubes_have_their_state(shared_data, name, start, low, high, off_deg):
    path = shared_data / "isis_cubes" / name
    state = read_isis_states(path).state("cube")
    assert state.time == pytest.approx(et_from_utc(start), abs=1e-3)
    distance = np.linalg.norm(state.scobj)
    assert low < distance < high
    assert np.degrees(np.arccos(state.axes[2] @ state.scobj / distance)) < off_deg
    assert np.linalg.norm(state.sun) == pytest.approx(1.0)


@pytest.mark.parametrize(("image", "serial"), [(1, "286265995:36824"), (2, "286272781:34203")])
def test_control_points_fall_on_the_lines_of_a_line_scanner(shared_data, image, serial):
    folder = shared_data / "moon_lola"
    path = folder / f"lidarObservationImage{image}.isd"
    tables, content = read_isd_states(path), json.loads(path.read_text())
    start, rate = content["starting_ephemeris_time"], content["line_scan_rate"][0][2]
    found, ranges = [], []
    for point in json.loads((folder / "lidarData.json").read_text())["points"]:
        ground = on_sphere(point["latitude"], point["longitude"], 1000.0 * point["radius"])
        for measure in point["measures"]:
            if serial not in measure["serialNumber"]:
                continue
            seen = _Sight(tables, ground)
            guess = start + rate * (measure["line"] - 0.5)
            time = brentq(seen.ahead, max(start, guess - 1.0), min(guess + 1.0, tables.span[1]))
            _, y, z = seen.at(time)
            true = 699.62 * y / z
            place = true
            for _ in range(30):
                place = true * (1.0 + 1.81e-5 * place**2)
            sample, line = 2548.0 + 142.857 * place, (time - start) / rate + 0.5
            found.append((sample - measure["sample"], line - measure["line"]))
        if serial in point["simultaneousImages"][0]:
            place = tables.state("x", point["time"]).position
            ranges.append(np.linalg.norm(place - ground) - 1000.0 * point["range"])
    # The measures were made with other kernels: they are off by one displacement of some metres,
    # and agree with each other to a hundredth of a pixel over 50000 lines.
    found = np.array(found)
    assert len(found) == 52
    assert found.std(axis=0).max() < 0.015
    assert np.abs(found.mean(axis=0)).max() < 20.0
    if image == 1:
        # 0.545 by LOLA's own positions: those of the camera's kernels are 96 mm lower.
        assert np.std(ranges) < 1.5e-3
        np.testing.assert_allclose(np.mean(ranges), 0.449, atol=1e-3)


class _Sight:
    """A ground point seen by a line scanner."""

    def __init__(self, tables, ground):
        self.tables, self.ground = tables, ground

    def at(self, time):
        state = self.tables.state("x", time)
        return state.axes @ (state.scobj + self.ground)

    def ahead(self, time):
        x, _, z = self.at(time)
        return x / z


def test_rosetta_poses_have_the_geometry_that_their_source_states(shared_data):
    rows = read_poses(shared_data / "rosetta_67p" / "navcam" / "poses.csv")
    states = [one.only() for one in rows.values()]
    assert len(states) == 70
    sun = np.array([state.sun for state in states])
    away = np.array([state.position / np.linalg.norm(state.position) for state in states])
    phase = np.degrees(np.arccos((sun * away).sum(axis=1)))
    assert phase.min() > 29.5
    assert phase.max() < 55.5
    np.testing.assert_allclose(np.degrees(np.arcsin(sun[:, 2])), 44.5, atol=0.6)
    # All look at the body, 14 to 22 m a pixel away.
    off = [np.degrees(np.arccos(s.axes[2] @ s.scobj / np.linalg.norm(s.scobj))) for s in states]
    assert max(off) < 2.5
    pixel = np.linalg.norm([s.scobj for s in states], axis=1) / 5863.364
    assert pixel.min() > 13.5
    assert pixel.max() < 22.5


def test_vesta_poses_have_the_phase_of_the_archive(shared_data):
    folder = shared_data / "vesta"
    with (folder / "frames.csv").open() as stream:
        frames = {row["file"]: row for row in csv.DictReader(stream)}
    pairs = read_colmap(folder, unit="km")
    assert [state.name for state, _ in pairs] == sorted(frames)
    for state, camera in pairs:
        row = frames[state.name]
        sun = on_sphere(float(row["subsolar_lat_deg"]), float(row["subsolar_lon_deg"]), 1.0)
        # The archive's phase angle is that on the boresight.
        phase = np.degrees(np.arccos(-sun @ state.axes[2]))
        assert phase == pytest.approx(float(row["phase_deg"]), abs=2e-4)
        # 0.38 km a pixel of 1/10715 of the focal length.
        assert camera == 0
        assert np.linalg.norm(state.scobj) / 10715.0 == pytest.approx(378.0, abs=2.0)


def test_attitudes_in_a_label_of_near_agree(shared_data, tmp_path):
    # The label has the boresight's right ascension, declination and north clock angle, and the
    # spacecraft's quaternion; the header has the positions of both, along J2000.
    folder = shared_data / "eros"
    label = (folder / "m0126360726f4_2p_cif_gbl.lbl").read_text()
    header = (folder / "m0126360726f4_2p_cif_gbl.fit").read_bytes()[:11520].decode("ascii")
    number = r"= *'?([-\d.]+)"
    sky = [
        float(re.search(rf"{name} +{number}", label)[1])
        for name in ("RIGHT_ASCENSION", "DECLINATION", "CELESTIAL_NORTH_CLOCK_ANGLE")
    ]
    words = re.search(r"EMECL_SC_QUATERNION = \((.*?)\)", label, re.DOTALL)[1].split(",")
    item = {n: float(re.search(rf"NEAR-0{n}{number}", header)[1]) for n in range(23, 31)}
    craft, target = (np.array([item[k] for k in range(a, a + 3)]) for a in (23, 27))
    turn = Rotation.from_quat([float(word) for word in [*words[1:], words[0]]]).as_matrix()
    # The boresight is the spacecraft's X; lines run along Y, samples against Z.
    rows = np.array([-turn[2], turn[1], turn[0]])
    quaternion = Rotation.from_matrix(rows).as_quat()[[3, 0, 1, 2]]
    common = dict(
        zip(("scx_km_j2000", "scy_km_j2000", "scz_km_j2000"), craft - target, strict=True)
    )
    common |= dict(zip(("sunx_j2000", "suny_j2000", "sunz_j2000"), -target, strict=True))
    common |= {"image": "MSI", "utc": "2000-02-19T08:55:00.4125"}
    states = []
    for attitude in (
        dict(zip(("ra_deg", "dec_deg", "twist_deg"), sky, strict=True)),
        dict(zip(("qw_j2000", "qx_j2000", "qy_j2000", "qz_j2000"), quaternion, strict=True)),
    ):
        columns = common | attitude
        path = tmp_path / "poses.csv"
        path.write_text(",".join(columns) + "\n" + ",".join(map(str, columns.values())) + "\n")
        # The rotation of Eros by the IAU's working group.
        (rows,) = read_poses(path, spin=Spin(11.35, 17.22, 326.07, 1639.38864745)).values()
        states.append(rows.only())
    # They differ by the alignment of the camera.
    found = compare_states(*states)
    assert 0.05 < np.degrees(np.linalg.norm(found.pointing)) < 0.12
    assert np.linalg.norm(found.camera_m) < 1e-6
    assert np.linalg.norm(states[0].scobj) == pytest.approx(1000.0 * item[30], abs=50.0)
    assert states[0].axes[2] @ states[0].scobj / np.linalg.norm(states[0].scobj) > 0.998
