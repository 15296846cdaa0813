"""``spcola images`` on images of missions: what the program finds by itself."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import app
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from fusion.stages.images import Turn
from fusion.stages.line_scans import line_scans_not_used
from fusion.workspace import new_workspace
from spcola.camera import Camera, SpcImage, project_image
from spcola.formats.images import open_image
from spcola.formats.shapes import read_shape, write_icq
from spcola.formats.states import read_isis_states
from spcola.imagematching.frames import compare_frame, render_frame
from spcola.shape import RayCaster
from spcola.shape.icq import IcqShape, icq_directions

MOON = 1_737_400.0
pytestmark = pytest.mark.real_data

NAVCAM = """[NAVCAM]
focal_length_mm = 152.5
center = [256.5, 256.5]
k_matrix = [[38.448288, 0.0, 0.0], [0.0, 38.448288, 0.0]]
size = [512, 512]
"""


def content(*arguments):
    result = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert result.exit_code == 0, result.output + result.stderr
    return json.loads(result.stdout)


def directions_of(path):
    """Unit vectors (4, 3) of a cube's footprint's corners: its ring has five steps a side."""
    label = path.read_bytes()[:65536].decode("latin-1")
    words = r"Object = Polygon\s+Name\s+= Footprint\s+StartByte = (\d+)\s+Bytes\s+= (\d+)"
    begin, size = (int(group) for group in re.search(words, label).groups())
    text = path.read_bytes()[begin - 1 : begin - 1 + size].decode("ascii")
    ring = re.search(r"\(\(\((.*?)\)\)\)", text)[1].split(",")[:20:5]
    lon, lat = np.radians([[float(word) for word in point.split()] for point in ring]).T
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


@pytest.fixture(scope="module")
def comet(shared_data, tmp_path_factory):
    """The 70 frames of 67P in a workspace, and what is found of them."""
    root = tmp_path_factory.mktemp("67p")
    folder = shared_data / "rosetta_67p" / "navcam"
    made = new_workspace(root / "ws", body="67P", shape=folder / "67p-4k.obj")
    (root / "navcam.toml").write_text(NAVCAM)
    command = [
        "images", made.root, *sorted(folder.glob("images/*.png")), "--poses",
        folder / "poses.csv", "--camera", root / "navcam.toml", "--letter", "N", "--report",
    ]  # fmt: skip
    return made, content(*command)


def test_orientation_and_offset_of_the_frames_of_67p(comet):
    _, found = comet
    assert len(found["new"]) == 70
    assert not found["remarks"]
    assert found["orientations"] == {"as-stored": 70}
    assert not found["doubts"]
    assert not found["likely"]
    fits = [one["fit"] for one in found["images"]]
    given = [fit["given"] for fit in fits]
    assert min(given) > 0.8
    assert max(given) < 0.98
    assert min(fit["correlation"] for fit in fits) > 0.85
    assert min(fit["correlation"] - fit["runner_up"] for fit in fits) > 0.05
    # The README of the data: 3.5 px rms an axis, up to 7.
    offsets = np.array([fit["offset_px"] for fit in fits])
    np.testing.assert_allclose(found["offset_rms_px"], 3.5, atol=0.5)
    assert 5.0 < np.abs(offsets).max() < 8.5
    overlap = np.array([[fit["overlap"], fit["overlap_given"]] for fit in fits])
    assert np.median(overlap[:, 0]) > 0.88
    assert (overlap[:, 0] > overlap[:, 1] - 0.02).all()


def test_triage_of_the_frames_of_67p(comet):
    _, found = comet
    assert found["counts"]["limb"] == 70
    resolution = [one["resolution_m"] for one in found["images"]]
    phase = [one["phase_deg"] for one in found["images"]]
    assert (min(resolution) > 13.5) & (max(resolution) < 22.5)
    assert (min(phase) > 29.0) & (max(phase) < 56.0)
    flagged = {one["original"]: set(one["flags"]) for one in found["images"] if one["flags"]}
    both = {"overexposed", "smeared"}
    assert flagged == {"20140808T183002.png": both, "20140808T213002.png": both}


def test_mirrored_frames_of_67p_are_named(comet, shared_data, tmp_path):
    folder = shared_data / "rosetta_67p" / "navcam"
    made = new_workspace(tmp_path / "ws", body="67P", shape=folder / "67p-4k.obj")
    (tmp_path / "navcam.toml").write_text(NAVCAM)
    found = content(
        "images", made.root, *sorted(folder.glob("images/*.png"))[::7], "--poses",
        folder / "poses.csv", "--camera", tmp_path / "navcam.toml", "--letter", "N", "--report",
        "--orientation", "mirrored-lines",
    )  # fmt: skip
    assert found["orientations"] == {"mirrored-lines": 10}
    assert not found["likely"]
    assert all("--orientation mirrored-lines" in line for line in found["doubtful"])


def test_mistakes_in_poses_of_67p_are_named(shared_data, tmp_path):
    folder = shared_data / "rosetta_67p" / "navcam"
    head, *rows = [row.split(",") for row in (folder / "poses.csv").read_text().splitlines()]
    rows = rows[::10]

    def changed(row, first, matrix):
        size = len(matrix)
        values = np.array([float(word) for word in row[first : first + size]])
        row[first : first + size] = [repr(float(v)) for v in matrix @ values]

    changed(rows[0], 2, -np.eye(3))
    changed(rows[1], 14, -np.eye(3))
    changed(rows[2], 5, np.eye(9)[[0, 3, 6, 1, 4, 7, 2, 5, 8]])
    changed(rows[3], 5, np.diag([1, 1, 1, -1, -1, -1, -1, -1, -1]))
    rows[4][1:], rows[6][1:] = rows[6][1:], rows[4][1:]
    table = tmp_path / "poses.csv"
    table.write_text("\n".join(",".join(row) for row in [head, *rows]) + "\n")
    (tmp_path / "navcam.toml").write_text(NAVCAM)
    made = new_workspace(tmp_path / "ws", body="67P", shape=folder / "67p-4k.obj")
    found = content(
        "images", made.root, *(folder / "images" / f"{row[0]}.png" for row in rows), "--poses",
        table, "--camera", tmp_path / "navcam.toml", "--report",
    )  # fmt: skip
    likely = {one["original"]: one["likely"] for one in found["images"]}
    codes = [likely[f"{row[0]}.png"] and likely[f"{row[0]}.png"]["code"] for row in rows]
    assert codes == [
        "v0-reversed", "sun-reversed", "axes-transposed", "cy-cz-reversed", "other-image", None,
        "other-image",
    ]  # fmt: skip
    assert {one["code"] for one in found["doubts"]} == {"looks-away"}
    assert min(one["correlation"] for one in likely.values() if one) > 0.9


def test_frames_of_vesta_with_a_colmap_model(shared_data, tmp_path):
    folder = shared_data / "vesta"
    made = new_workspace(tmp_path / "ws", body="Vesta", shape=folder / "vesta_5002.ply")
    found = content(
        "images", made.root, *sorted(folder.glob("images/*.png")), "--states", "colmap", "--model",
        folder, "--times", folder / "frames.csv", "--report",
    )  # fmt: skip
    assert [one["state"]["source"] for one in found["new"]] == ["colmap"] * 4
    assert found["orientations"] == {"as-stored": 4}
    fits = [one["fit"] for one in found["images"]]
    assert min(fit["correlation"] for fit in fits) > 0.93
    assert min(fit["overlap"] for fit in fits) > 0.96
    # Together off by 1.6 lines, from frame to frame by tenths.
    offsets = np.array([fit["offset_px"] for fit in fits])
    np.testing.assert_allclose(offsets.mean(axis=0), [-0.2, 1.6], atol=0.3)
    assert offsets.std(axis=0).max() < 0.6
    phase = [one["phase_deg"] for one in found["images"]]
    np.testing.assert_allclose(phase, [29.51, 29.25, 28.99, 28.48], atol=0.2)


def test_a_sun_in_another_frame_is_noticed_at_vesta(shared_data, tmp_path):
    # With the Sun of the archive's other frame, 210° away, the frames look like nothing.
    folder = shared_data / "vesta"
    made = new_workspace(tmp_path / "ws", body="Vesta", shape=folder / "vesta_5002.ply")
    rows = (folder / "frames.csv").read_text().splitlines()
    head, *rest = [row.split(",") for row in rows]
    place = head.index("subsolar_lon_deg")
    for row in rest:
        row[place] = str(float(row[place]) + 210.0)
    table = tmp_path / "frames.csv"
    table.write_text("\n".join(",".join(row) for row in [head, *rest]) + "\n")
    found = content(
        "images", made.root, *sorted(folder.glob("images/*.png")), "--states", "colmap", "--model",
        folder, "--times", table, "--report",
    )  # fmt: skip
    assert [one["flags"] for one in found["images"]] == [["unmatched"]] * 4


def test_cubes_of_apollo_come_in_with_their_cameras(shared_data, tmp_path):
    write_icq(tmp_path / "moon.txt", IcqShape(MOON * icq_directions(48)), digits=9)
    made = new_workspace(tmp_path / "ws", body="Moon", shape=tmp_path / "moon.txt")
    cubes = sorted((shared_data / "apollo15").glob("*.cub"))
    found = content("images", made.root, *cubes, "--states", "label", "--report")
    assert len({one["name"] for one in found["new"]}) == 3
    for record, seen, path in zip(found["new"], found["images"], cubes, strict=True):
        fit = record["camera_fit"]
        assert fit["model"] == "hasselblad"
        assert fit["rms_px"] < 0.03
        assert 0.01 < fit["largest_px"] < 0.2
        assert (made.root / "SUMFILES" / fit["file"]).is_file()
        assert (seen["scene"], seen["flags"]) == ("filled", [])
        assert 100e3 < seen["range_m"] < 140e3
        assert 125.0 < seen["resolution_m"] < 145.0
        image = made.image(record["name"])
        assert image.camera.distortion_model == "hasselblad"
        # The label used heights of LOLA: each corner may lie on its line of changing height.
        corners = [[0.5, 0.5], [500.5, 0.5], [500.5, 500.5], [0.5, 500.5]]
        places = np.array([
            np.stack(project_image(image, (MOON + up) * directions_of(path)), axis=-1)
            for up in (0.0, 1000.0)
        ])  # fmt: skip
        step = places[1] - places[0]
        across = np.stack([-step[:, 1], step[:, 0]], axis=1)
        across /= np.linalg.norm(step, axis=1)[:, None]
        assert np.abs(((corners - places[0]) * across).sum(axis=1)).max() < 0.01


def test_a_line_scan_comes_in_with_a_state_for_each_line(shared_data, tmp_path):
    write_icq(tmp_path / "moon.txt", IcqShape(MOON * icq_directions(48)), digits=9)
    made = new_workspace(tmp_path / "ws", body="Moon", shape=tmp_path / "moon.txt")
    cube = shared_data / "isis_cubes" / "M143947267L.cal.echo.crop.cub"
    found = content("images", made.root, cube, "--states", "label", "--report")
    (record,), (seen,) = found["new"], found["images"]
    assert record["state"] == {
        "source": "isis", "from": str(cube), "solution": "imported", "lines": 400,
    }  # fmt: skip
    image = made.line_scan(record["name"])
    # The tables begin where the first line does.
    tables = read_isis_states(cube)
    line_s = 0.3632e-3 * 1.0045
    np.testing.assert_allclose(image.scan.times[0] - 0.5 * line_s, tables.span[0], atol=1e-7)
    np.testing.assert_allclose(np.diff(image.scan.times), line_s, atol=1e-7)
    state = tables.state("x", image.scan.times[123])
    np.testing.assert_allclose(image.scan.positions[123], state.position, atol=1e-6)
    np.testing.assert_allclose(image.scan.axes[123], state.axes, atol=1e-12)
    # 7 µm at 699.62 mm; the crop lies off the axis, so corners and range follow from the lines.
    assert seen["scene"] == "filled"
    assert seen["resolution_m"] == pytest.approx(seen["range_m"] * 7e-3 / 699.62, rel=1e-4)
    lon, lat = np.radians(np.array(seen["corners_deg"]).T)
    east = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    origins, beams = image.rays(
        np.array([0.5, 400.5, 400.5, 0.5]), np.array([0.5, 0.5] + [400.5] * 2)
    )
    away = np.linalg.norm(np.cross(east * MOON - origins, beams), axis=1)
    assert away.max() < 100.0
    width = MOON * np.linalg.norm(east[1] - east[0])
    assert width == pytest.approx(400 * seen["resolution_m"], rel=0.05)
    # Commands that need one state for an image leave it out, and say so.
    assert made.image_names() == []
    shown = content("info", made.root)
    assert (shown["images"], shown["line_scans"]) == (0, 1)
    assert content("info", made.line_scan_path(record["name"]))["lines"] == 400
    (left,) = line_scans_not_used(made).values()
    assert left["code"] == "line-scan"
    assert "1 line-scan image has a state for each line" in left["text"]


def test_navcam_of_bennu_shows_the_ground_that_its_tables_state(shared_data):
    # OpenCV's camera of the label, reduced ten times; y of the focal plane runs against the lines.
    path = shared_data / "isis_cubes" / "20200303T213031S138_ncm_L0-reduced.cub"
    image = open_image(path)
    pixels = image.read()
    state = read_isis_states(path).state("navcam", image.label.mid_exposure().et)
    factor = 2592.0 / 259.0
    center = (np.array([1269.083, 950.747]) - 0.5) / factor + 0.5
    per_mm = 1.0 / (0.0022 * factor)
    lens = Camera(
        7.641, center, [[per_mm, 0, 0], [0, -per_mm, 0]], 259, 194, "brown",
        [-0.53766, 0.37526, 0.00023432, 0.00090875, -0.18368, 0, 0, 0],
    )  # fmt: skip
    shape = shared_data / "bennu" / "g_12570mm_alt_obj_0000n00000_v014.obj"
    view = SpcImage("navcam", "2020-03-03", lens, state.scobj, state.axes, state.sun)
    rendered = render_frame(RayCaster(read_shape(shape)), view, step=2)
    assert rendered.body.all()
    dn = np.where(pixels.valid, pixels.values, 0.0)
    turns = [turn for turn in Turn if not turn.exchanges]
    # A facet is 19 pixels wide, and nine tenths of the image's contrast is finer: what is compared
    # are the scales that the shape has.
    model = replace(rendered, brightness=_band(rendered.brightness, 3.0, 9.0))
    found = [
        compare_frame(_band(turn.orientation.apply(dn), 6.0, 18.0), model, lowest=200, reach_px=16)
        for turn in turns
    ]
    scores = [one.correlation for one in found]
    assert scores[0] > 0.6
    assert max(scores[1:]) < 0.45
    np.testing.assert_allclose(found[0].offset, [-1.9, -2.7], atol=0.5)


def _band(picture, fine, coarse):
    """Return what of a picture lies between two widths of smoothing."""
    whole = np.asarray(picture, dtype=np.float64)
    return gaussian_filter(whole, fine) - gaussian_filter(whole, coarse)


def test_the_msi_frame_shows_no_body_by_its_label(shared_data, tmp_path):
    # Its label gives no centre on the body, and its attitude points past it: stray light.
    folder = shared_data / "eros"
    label = (folder / "m0126360726f4_2p_cif_gbl.lbl").read_text()
    header = (folder / "m0126360726f4_2p_cif_gbl.fit").read_bytes()[:11520].decode("ascii")
    number = r"= *'?([-\d.]+)"
    words = re.search(r"EMECL_SC_QUATERNION = \((.*?)\)", label, re.DOTALL)[1].split(",")
    item = {n: float(re.search(rf"NEAR-0{n}{number}", header)[1]) for n in range(23, 31)}
    craft, eros = (np.array([item[k] for k in range(a, a + 3)]) for a in (23, 27))
    turn = Rotation.from_quat([float(word) for word in [*words[1:], words[0]]]).as_matrix()
    rows = np.array([-turn[2], turn[1], turn[0]])
    columns = {
        "image": "m0126360726f4_2p_cif_gbl", "utc": "2000-02-19T08:55:00.4125",
        **dict(zip(("scx_km_j2000", "scy_km_j2000", "scz_km_j2000"), craft - eros, strict=True)),
        **dict(zip(("sunx_j2000", "suny_j2000", "sunz_j2000"), -eros, strict=True)),
        **dict(zip(("qw_j2000", "qx_j2000", "qy_j2000", "qz_j2000"),
                   Rotation.from_matrix(rows).as_quat()[[3, 0, 1, 2]], strict=True)),
    }  # fmt: skip
    (tmp_path / "poses.csv").write_text(
        ",".join(columns) + "\n" + ",".join(str(value) for value in columns.values()) + "\n"
    )
    (tmp_path / "eros.tpc").write_text(
        "KPL/PCK\n\\begindata\nBODY2000433_POLE_RA = ( 11.35 0. 0. )\n"
        "BODY2000433_POLE_DEC = ( 17.22 0. 0. )\nBODY2000433_PM = ( 326.07 1639.38864745 0. )\n"
    )
    # 33.77 m a pixel at 354.5 km.
    per_mm = 354.5 / 0.03377 / 167.35
    (tmp_path / "msi.toml").write_text(
        "[MSI]\nfocal_length_mm = 167.35\ncenter = [269.0, 206.5]\n"
        f"k_matrix = [[{per_mm}, 0.0, 0.0], [0.0, {per_mm}, 0.0]]\nsize = [537, 412]\n"
    )
    shape = tmp_path / "eros.obj"
    shape.write_bytes((folder / "eros007790.tab").read_bytes())
    made = new_workspace(tmp_path / "ws", body="Eros", shape=shape, faces_from=0)
    found = content(
        "images", made.root, folder / "m0126360726f4_2p_cif_gbl.fit", "--poses",
        tmp_path / "poses.csv", "--camera", tmp_path / "msi.toml", "--pck", tmp_path / "eros.tpc",
        "--body", 2000433, "--report",
    )  # fmt: skip
    (one,) = found["images"]
    assert one["scene"] == "no body"
    assert one["range_m"] == pytest.approx(354_545.0, abs=50.0)
    assert one["resolution_m"] == pytest.approx(33.77, rel=1e-3)
    (record,) = found["new"]
    assert any("contradict" in note for note in record["notes"])


def test_two_sources_of_a_state_are_compared(shared_data, tmp_path):
    path = shared_data / "isis_cubes" / "20200303T213031S138_ncm_L0-reduced.cub"
    state = read_isis_states(path).state("navcam", open_image(path).label.mid_exposure().et)
    # A table whose position is off by 3 m along Cx.
    place = state.scobj + 3.0 * state.axes[0]
    names = "image,et,v0x_m,v0y_m,v0z_m,cxx,cxy,cxz,cyx,cyy,cyz,czx,czy,czz,sunx,suny,sunz"
    values = [path.stem, *map(float, [state.time, *place, *state.axes.ravel(), *state.sun])]
    (tmp_path / "poses.csv").write_text(f"{names}\n{','.join(map(str, values))}\n")
    (tmp_path / "navcam.toml").write_text(
        "[NAVCAM]\nfocal_length_mm = 7.64\ncenter = [130.0, 97.5]\n"
        "k_matrix = [[45.4, 0.0, 0.0], [0.0, -45.4, 0.0]]\nsize = [259, 194]\n"
    )
    camera = ("--camera", tmp_path / "navcam.toml")
    made = new_workspace(tmp_path / "ws", body="Bennu")
    (one,) = content("images", made.root, path, "--poses", tmp_path / "poses.csv", *camera)["new"]
    assert any("give another state: 3 m, 0°" in note for note in one["notes"]), one["notes"]
    assert one["state"]["source"] == "poses"
    other = new_workspace(tmp_path / "other", body="Bennu")
    (one,) = content("images", other.root, path, "--states", "label", *camera)["new"]
    assert one["state"]["source"] == "isis"
    np.testing.assert_allclose(other.image(one["name"]).scobj, state.scobj, atol=1e-3)
