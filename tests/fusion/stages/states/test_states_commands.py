"""``spcola kernels`` and ``spcola sumfiles``: from .SUM files to kernels and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import spiceypy
from astropy.io import fits
from command_line import call, called, refused
from scipy.spatial.transform import Rotation

from fusion.workspace import SETTINGS_FILE, new_workspace
from fusion.workspace.settings import Settings, write_settings
from spcola.camera import Camera, SpcImage
from spcola.camera.instrument import Instrument
from spcola.camera.linescan import LineScan, LineScanImage
from spcola.formats.cameras import write_cameras
from spcola.formats.solution import read_nominal, read_summary, write_list, write_summary
from spcola.formats.solution.line_scan import write_line_scan
from spcola.navigation import SPICE_LOCK, Spin, et_from_utc, utc_from_et

SPIN = Spin(85.45, -60.37, 140.69, 2011.15)
CAMERA = Camera(125.2, [512.5, 512.5], [[117.6, 0, 0], [0, -117.6, 0]], 1024, 1024)
START = et_from_utc("2019-03-03T10:59:40.279")
SUN = np.array([1.2e11, -8.0e10, 3.0e10])
DRIFT = np.array([0.05, 0.08, -0.02])
TABLE = {"spacecraft": "-64", "body": 2101955}


def image_at(number, seconds):
    utc = utc_from_et(START + seconds)
    turn = SPIN.axes([et_from_utc(utc)])[0]
    place = turn @ (np.array([4000.0, -3000.0, 500.0]) + seconds * DRIFT)
    looking = Rotation.align_vectors([[0, 0, 1.0]], [-place])[0]
    axes = (Rotation.from_rotvec([0.01, 0.02, number]) * looking).as_matrix()
    sun = turn @ (SUN / np.linalg.norm(SUN))
    return SpcImage(f"P{number:04d}", utc, CAMERA, -place, axes, sun, thresholds=(200, 16000))


def workspace_at(folder, **tables):
    made = new_workspace(folder, body="Bennu")
    settings = Settings().with_table("body", name="Bennu")
    for table, values in tables.items():
        settings = settings.with_table(table, **values)
    write_settings(folder / SETTINGS_FILE, settings)
    return made


ROTATION = {
    "pole_ra_deg": 85.45,
    "pole_dec_deg": -60.37,
    "meridian_deg": 140.0,
    "shift_meridian_deg": 0.69,
    "rate_deg_per_day": 2011.15,
}


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """A workspace with states of six images."""
    root = tmp_path_factory.mktemp("solved") / "ws"
    made = workspace_at(root, spice=TABLE, spin=ROTATION)
    for number, seconds in enumerate((0.0, 60.0, 200.0, 400.5, 5000.0, 5060.0)):
        image = image_at(number, seconds)
        write_summary(made.image_path(image.name), image)
    line = replace(CAMERA, height=1)
    scan = LineScan(line, np.arange(2.0), np.full((2, 3), 4e3), np.tile(np.eye(3), (2, 1, 1)))
    write_line_scan(made.line_scan_path("L1"), LineScanImage("L1", scan, np.array([1.0, 0.0, 0.0])))
    return made


@pytest.fixture(scope="module")
def exported(solved, tmp_path_factory):
    """Its kernels, and an SPK of the Sun next to them."""
    folder = tmp_path_factory.mktemp("exported")
    found = called("kernels", solved.root, folder / "kernels")
    path = folder / "sun.bsp"
    ends = np.array([START - 1e5, START + 1e5])
    states = np.tile(np.concatenate([SUN, np.zeros(3)]) / 1000.0, (2, 1))
    with SPICE_LOCK:
        handle = spiceypy.spkopn(str(path), "SUN", 0)
        spiceypy.spkw09(handle, 10, 2101955, "J2000", *ends, "S", 1, 2, states, ends)
        spiceypy.spkcls(handle)
    return folder, found


def test_kernels_are_written_and_read_back(solved, exported):
    folder, found = exported
    assert (found["images"], found["cameras"], found["segments"]) == (6, 1, 2)
    assert found["read_back_position_m"] < 1e-3
    assert found["read_back_pointing_rad"] < 1e-6
    assert sorted(found["files"]) == sorted(path.name for path in (folder / "kernels").iterdir())
    assert "is there already" in refused("kernels", solved.root, folder / "kernels")
    left = found["images_not_used"]
    assert (left["code"], left["images"]) == ("line-scan", ["L1"])
    text = call("kernels", solved.root, folder / "again").stdout
    assert "images: 6, cameras: 1, 2019 MAR 03 10:59:40.279" in text


def table_of(path, images, column="utc"):
    lines = [f"image,{column}", *(f"{image.name},{image.utc}" for image in images)]
    path.write_text("\n".join(lines) + "\n")
    return path


def sumfiles(exported, root, *more):
    folder, _ = exported
    kernels = ["--kernel", folder / "kernels" / "spc_states.tm", "--kernel", folder / "sun.bsp"]
    frame = ["--frame", "SC64_SPC_1", "--correction", "none"]
    return ("sumfiles", root, *more, *frame, *kernels)


def test_the_states_come_back_as_sum_and_nom(solved, exported, tmp_path):
    images = solved.images()
    made = workspace_at(tmp_path / "ws", spice=TABLE)
    write_list(made.root / "PICTLIST.TXT", ["OLD"])
    table = table_of(tmp_path / "images.csv", images)
    like = solved.image_path("P0000")
    command = sumfiles(
        exported, made.root, table, "--camera", like, "--sigma-m", 5, "--sigma-mrad", 2
    )
    found = called(*command)
    assert [row["image"] for row in found["images"]] == [image.name for image in images]
    for number, image in enumerate(images):
        again = read_summary(made.image_path(image.name))
        np.testing.assert_allclose(again.scobj, image.scobj, atol=1e-3)
        np.testing.assert_allclose(again.axes, image.axes, atol=1e-8)
        np.testing.assert_allclose(again.sun, image.sun, atol=1e-8)
        assert (again.utc, again.thresholds) == (image.utc, (200, 16000))
        np.testing.assert_array_equal(again.camera.k_matrix, CAMERA.k_matrix)
        np.testing.assert_allclose(again.scobj_sigma, 5.0)
        np.testing.assert_allclose(again.pointing_sigma, 2e-3)
        nominal = read_nominal(made.root / "NOMINALS" / f"{image.name}.NOM")
        np.testing.assert_allclose(nominal.scobj, image.scobj, atol=1e-3)
        # The rate of the body-fixed position of a spacecraft that drifts.
        if number < 4:
            time = et_from_utc(image.utc)
            turns = SPIN.axes([time - 1.0, time + 1.0])
            drift = np.array([4000.0, -3000.0, 500.0]) + (time - START) * DRIFT
            ends = [
                turn @ (drift + step * DRIFT) for turn, step in zip(turns, (-1, 1), strict=True)
            ]
            np.testing.assert_allclose(nominal.velocity, (ends[1] - ends[0]) / 2.0, atol=1e-4)
    assert (made.root / "PICTLIST.TXT").read_text().split() == [
        "OLD", *(image.name for image in images), "END",
    ]  # fmt: skip
    assert "is there already" in refused(*command)


def test_comparison_finds_a_moved_state(solved, exported, tmp_path):
    made = workspace_at(tmp_path / "ws", spice=TABLE)
    for image in solved.images():
        moved = replace(image, scobj=image.scobj + 3.0 * image.axes[0])
        write_summary(made.image_path(image.name), moved)
    found = called(*sumfiles(exported, made.root, "--compare"))
    assert len(found["images"]) == 6
    for row in found["images"]:
        assert row["sources"] == ["spice", "sum"]
        np.testing.assert_allclose(row["camera_m"], [3.0, 0.0, 0.0], atol=1e-3)
        np.testing.assert_allclose(row["pointing_deg"], 0.0, atol=1e-6)
        np.testing.assert_allclose(row["pixels"], [-3.0 / 5025 * 125.2 * 117.6, 0.0], atol=0.1)
    text = call(*sumfiles(exported, made.root, "--compare")).stdout
    assert "along Cx, Cy, Cz, m: 3 (3)" in text


def poses_of(path, images):
    """A table of poses along J2000."""
    names = ["name", "et", *(f"sc{a}_m_j2000" for a in "xyz"), *(f"q{a}_j2000" for a in "wxyz")]
    lines = [",".join([*names, "S x", "S y", "S z"])]
    for image in images:
        time = et_from_utc(image.utc)
        turn = SPIN.axes([time])[0]
        turned = Rotation.from_matrix(image.axes @ turn).as_quat()[[3, 0, 1, 2]]
        values = [time, *(turn.T @ image.position), *turned, *image.sun]
        lines.append(",".join([image.name, *(repr(float(value)) for value in values)]))
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_table_of_poses_becomes_sum_files(solved, tmp_path):
    images = solved.images()
    table = poses_of(tmp_path / "poses.csv", images)
    made = workspace_at(tmp_path / "ws", spice=TABLE, spin=ROTATION)
    like = solved.image_path("P0000")
    sun = [word for a in "xyz" for word in ("--columns", f"sun{a}=S {a}")]
    command = ("sumfiles", made.root, "--poses", table, "--camera", like)
    assert "no direction to the Sun" in refused(*command)
    assert call(*command, *sun).stdout.startswith("Wrote .SUM of 6 images")
    for image in images:
        again = made.image(image.name)
        np.testing.assert_allclose(again.scobj, image.scobj, atol=1e-3)
        np.testing.assert_allclose(again.axes, image.axes, atol=1e-8)
        np.testing.assert_allclose(again.sun, image.sun, atol=1e-8)
    assert not list((made.root / "NOMINALS").iterdir())
    compared = called("sumfiles", solved.root, "--compare", "--poses", table, *sun)
    assert all(np.abs(row["camera_m"]).max() < 1e-3 for row in compared["images"])
    call(*command, "--columns", "nonsense", code=2)
    long = tmp_path / "long.csv"
    long.write_text(table.read_text().replace("P0003", "MUCHTOOLONGNAME"))
    line = refused("sumfiles", workspace_at(tmp_path / "new", spin=ROTATION).root, "--poses", long,
                   "--camera", like, *sun)  # fmt: skip
    assert "SUMFILES/MUCHTOOLONGNAME.SUM: image name" in line
    assert not list((tmp_path / "new" / "SUMFILES").iterdir())
    # Without a rotation an inertial table cannot be used.
    other = workspace_at(tmp_path / "other")
    assert "rotation of the body is not stated" in refused(
        "sumfiles", other.root, "--poses", table, "--camera", like, *sun
    )


def test_a_start_and_an_exposure_give_the_middle(solved, exported, tmp_path):
    made = workspace_at(tmp_path / "ws", spice=TABLE)
    image = solved.image("P0001")
    start = utc_from_et(et_from_utc(image.utc) - 0.1)
    (tmp_path / "images.csv").write_text(f"name,utc,exposure_ms\nP0001,{start},200\n")
    like = solved.image_path("P0000")
    call(*sumfiles(exported, made.root, tmp_path / "images.csv", "--camera", like))
    assert made.image("P0001").utc == image.utc


def test_the_camera_may_come_from_a_camera_file(solved, exported, tmp_path):
    made = workspace_at(tmp_path / "ws", spice=TABLE)
    table = table_of(tmp_path / "images.csv", solved.images()[:1])
    path = tmp_path / "camera.toml"
    write_cameras(path, [Instrument("MAP", CAMERA)])
    call(*sumfiles(exported, made.root, table, "--camera", path))
    again = made.image("P0000")
    assert again.camera.focal_length_mm == CAMERA.focal_length_mm
    np.testing.assert_array_equal(again.camera.k_matrix, CAMERA.k_matrix)
    assert again.thresholds == (0, 65535)
    write_cameras(path, [Instrument("MAP", CAMERA), Instrument("POLY", CAMERA)])
    other = workspace_at(tmp_path / "other", spice=TABLE)
    assert "has the cameras MAP, POLY" in refused(
        *sumfiles(exported, other.root, table, "--camera", path)
    )


def test_images_are_named_by_the_rule(solved, exported, tmp_path):
    made = workspace_at(tmp_path / "ws", spice=TABLE)
    image = solved.image("P0001")
    (tmp_path / "images.csv").write_text(f"file,utc,filter\nlong_name_1.fits,{image.utc},PAN\n")
    like = solved.image_path("P0000")
    command = sumfiles(exported, made.root, tmp_path / "images.csv", "--camera", like)
    found = called(*command, "--letter", "M")
    seconds = int(et_from_utc(image.utc))
    (row,) = found["images"]
    assert (row["image"], row["original"]) == (f"M{seconds}PA", "long_name_1.fits")
    np.testing.assert_allclose(made.image(row["image"]).scobj, image.scobj, atol=1e-3)


@pytest.mark.real_data
def test_the_label_of_an_image_gives_its_time(shared_data, solved, exported, tmp_path):
    made = workspace_at(tmp_path / "ws", spice=TABLE)
    cube = shared_data / "isis_cubes" / "20200303T213031S138_ncm_L0-reduced.cub"
    like = solved.image_path("P0000")
    line = refused(*sumfiles(exported, made.root, "--image", cube, "--camera", like))
    # The kernels are of another year.
    assert "20200303T213031S138_ncm_L0-reduced, 2020 MAR 03 21:30:31" in line
    plain = shared_data / "vesta" / "images" / "00000000.png"
    assert "does not state when" in refused(
        *sumfiles(exported, made.root, "--image", plain, "--camera", like)
    )


def test_what_is_missing_is_named(solved, exported, tmp_path):
    made = workspace_at(tmp_path / "ws")
    like = solved.image_path("P0000")
    table = table_of(tmp_path / "images.csv", solved.images())
    command = sumfiles(exported, made.root, table, "--camera", like)
    assert "[spice] spacecraft: must be given" in refused(*command)
    named = (*command, "--spacecraft", "-64", "--body", 2101955)
    late = tmp_path / "late.csv"
    late.write_text("image,utc\nP9,2019-03-03T14:00:00\n")
    gap = refused(*["sumfiles", made.root, late, *named[3:]])
    assert "P9" in gap
    assert "pointing ends" in gap
    assert not list((made.root / "SUMFILES").iterdir())
    # Without the Sun, and with a name that SPC cannot have.
    place = named.index(exported[0] / "sun.bsp")
    dark = (*named[: place - 1], *named[place + 1 :])
    assert "do not give the Sun" in refused(*dark)
    table.write_text("image,utc\nMUCHTOOLONGNAME,2019-03-03T10:59:40.279\n")
    assert "image name 'MUCHTOOLONGNAME' has 15" in refused(*named)
    table.write_text("image\nP1\n")
    assert "states no time" in refused(*named)
    assert "holds no image" in refused("sumfiles", made.root, "--compare", "--frame", "X")
    assert "[spice] kernels: holds no kernel" in refused(
        "sumfiles", made.root, late, "--camera", like, "--frame", "X"
    )
    assert call("sumfiles", made.root, table, code=2)
    assert call("sumfiles", made.root, table, "--camera", like, code=2)
    assert call("sumfiles", made.root, table, "--frame", "X", code=2)


def test_kernels_need_a_rotation_and_images(solved, tmp_path):
    made = workspace_at(tmp_path / "ws", spice=TABLE)
    assert "the rotation of the body" in refused("kernels", made.root, tmp_path / "out")
    pck = tmp_path / "body.tpc"
    pck.write_text(
        "KPL/PCK\n\\begindata\nBODY2101955_POLE_RA = ( 85.45 )\nBODY2101955_POLE_DEC = ( -60.37 )\n"
        "BODY2101955_PM = ( 140.69 2011.15 )\n\\begintext\n"
    )
    assert "there is no image" in refused("kernels", made.root, tmp_path / "out", "--pck", pck)
    image = image_at(0, 0.0)
    write_summary(made.image_path(image.name), image)
    found = called("kernels", made.root, tmp_path / "out", "--pck", pck)
    assert found["images"] == 1
    assert "unknown to SPICE" in refused(
        "kernels", made.root, tmp_path / "other", "--pck", pck, "--spacecraft", "NO SUCH CRAFT"
    )
    assert not (tmp_path / "other").exists()


@pytest.mark.real_data
def test_seventy_poses_of_a_comet_become_sum_files(shared_data, tmp_path):
    folder = shared_data / "rosetta_67p"
    made = workspace_at(tmp_path / "ws")
    found = called(
        *("sumfiles", made.root, "--poses", folder / "navcam" / "poses.csv"),
        *("--camera", folder / "W48230079013.SUM", "--letter", "N"),
    )
    assert len(made.image_names()) == len(found["images"]) == 70
    row = next(row for row in found["images"] if row["original"] == "20140805T200719")
    assert row["image"] == "N460541306"
    image = made.image(row["image"])
    np.testing.assert_allclose(image.scobj, [67871.148108, -105289.270599, -36719.898695])
    assert et_from_utc(image.utc) == pytest.approx(et_from_utc("2014-08-05T20:07:19.020"), abs=1e-3)


def mapcam_kernels(shared_data):
    """The options that name the kernels of a day of MapCam."""
    folder = shared_data / "bennu" / "kernels_mapcam_20190303"
    texts = sorted(path for path in folder.glob("*.t*") if path.suffix != ".ti")
    kernels = [*texts, *sorted(folder.glob("*.x*"))]
    return [word for kernel in kernels for word in ("--kernel", kernel)]


@pytest.mark.real_data
def test_mapcam_by_its_clock(shared_data, tmp_path):
    made = workspace_at(tmp_path / "ws", spice=TABLE)
    (tmp_path / "images.csv").write_text(
        "image,clock,exposure_ms,filter\nmap_iofL2pan,3/0604882742.23115,5.285275,PAN\n"
    )
    write_cameras(tmp_path / "map.toml", [Instrument("MAPCAM", CAMERA)])
    found = called(
        *("sumfiles", made.root, tmp_path / "images.csv", "--letter", "M"),
        *("--camera", tmp_path / "map.toml", "--frame", "ORX_OCAMS_MAPCAM"),
        *mapcam_kernels(shared_data),
    )
    (row,) = found["images"]
    assert (row["image"], row["original"]) == ("M604882849PA", "map_iofL2pan")
    image = made.image(row["image"])
    assert image.utc == "2019 MAR 03 10:59:40.247"
    assert np.linalg.norm(image.scobj) == pytest.approx(6593.743, abs=1e-3)
    nominal = read_nominal(made.root / "NOMINALS" / f"{row['image']}.NOM")
    # The body turns under the spacecraft.
    assert 2.0 < np.linalg.norm(nominal.velocity) < 3.0


def exposed(path, utc, size=1024, **header):
    """A FITS image whose exposure of 20 ms has its middle at a time."""
    unit = fits.PrimaryHDU(np.full((size, size), 500, np.uint16) + np.arange(size, dtype=np.uint16))
    unit.header["DATE-OBS"] = utc_from_et(et_from_utc(utc) - 0.01, 6)
    unit.header["EXPTIME"] = 0.02
    unit.header.update(header)
    unit.writeto(path)
    return path


def test_images_come_in_with_states_by_kernels(solved, exported, tmp_path):
    images = solved.images()
    made = workspace_at(tmp_path / "ws", spice=TABLE)
    paths = [exposed(tmp_path / f"{image.name}.fit", image.utc) for image in images]
    command = sumfiles(exported, made.root, *paths, "--states", "spice")[1:]
    like = ("--camera", solved.image_path("P0000"))
    found = called("images", *command, *like)
    assert [one["state"]["source"] for one in found["new"]] == ["spice"] * 6
    for image in images:
        written = made.image(image.name)
        np.testing.assert_allclose(written.scobj, image.scobj, atol=2e-3)
        np.testing.assert_allclose(written.axes, image.axes, atol=2e-6)
        # The thresholds of the .SUM file that gives the camera.
        assert written.thresholds == (200, 16000)
        assert (made.root / "NOMINALS" / f"{image.name}.NOM").is_file()
    late = exposed(tmp_path / "LATE.fit", utc_from_et(START + 3000.0))
    line = refused("images", made.root, late, *command[7:], *like)
    assert "LATE" in line
    assert not made.exposure_path("LATE").exists()


@pytest.mark.real_data
def test_an_image_of_mapcam_comes_in_with_its_kernels(shared_data, tmp_path):
    made = workspace_at(tmp_path / "ws", spice=TABLE)
    write_cameras(tmp_path / "map.toml", [Instrument("MAPCAM", CAMERA)])
    utc = "2019-03-03T10:59:40.2473"
    path = exposed(tmp_path / "map_iofL2pan_V001.fits", utc, FILTER="PAN")
    common = ("--frame", "ORX_OCAMS_MAPCAM", "--camera", tmp_path / "map.toml")
    (one,) = called(
        *("images", made.root, path, "--states", "spice", *common),
        *mapcam_kernels(shared_data),
    )["new"]
    assert (one["name"], one["original"]) == ("M604882849PA", "map_iofL2pan_V001.fits")
    assert np.linalg.norm(made.image(one["name"]).scobj) == pytest.approx(6593.743, abs=1e-2)
    # The camera of the kernels sees the body: at 6.6 km its radius is 2.1°.
    image = made.image(one["name"])
    away = image.scobj / np.linalg.norm(image.scobj)
    assert np.degrees(np.arccos(image.boresight @ away)) < 2.2
