"""The .SUM and .NOM formats."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from spcola.camera import Camera, ImagePoint, SpcImage
from spcola.camera.owen_fit import camera_difference
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.solution import read_nominal, read_summary, write_nominal, write_summary
from spcola.navigation import NominalState

# Axes: a turn by 3-4-5 about z; the Sun in the x-z plane.
GOOD = """\
P600069148F2
2019 MAR 03 11:22:33.456
  1024  1020   500 65535                                       NPX, NLN, THRSH
    0.1356800000D+03    0.5117000000D+03    0.5106000000D+03   MMFL, CTR
   -0.1430589240D+01   -0.3893115914D+00    0.8458863431D+00   SCOBJ
    0.6000000000D+00    0.8000000000D+00    0.0000000000D+00   CX
   -0.8000000000D+00    0.6000000000D+00    0.0000000000D+00   CY
    0.0000000000D+00    0.0000000000D+00    0.1000000000D+01   CZ
    0.6000000000D+00    0.0000000000D+00    0.8000000000D+00   SZ
   37.0371    0.1240    0.0000   -0.1240  -37.0371    0.0000   K-MATRIX
    0.10000D-03    0.00000D+00   -0.20000D-06    0.00000D+00   DISTORTION
    0.3907025850D-01    0.3696649938D-01    0.3761399275D-01   SIGMA_VSO
    0.2231524849D-03    0.2231586132D-03    0.5515340338D-03   SIGMA_PTG
LANDMARKS
FA0115    533.53    475.22
FC0098    513.55    501.38 *
LIMB FITS
GD0036    493.55   -498.21      1.50
END FILE
"""

NOMINAL = """\
P600069148F2
    0.1000000000D-03   -0.2000000000D-03    0.3000000000D-03   J2000
   -0.1430589240D+01   -0.3893115914D+00    0.8458863431D+00   SCOBJ
    0.3907025850D-01    0.3696649938D-01    0.3761399275D-01   SIGMA_VSO
    0.6000000000D+00    0.8000000000D+00    0.0000000000D+00   CX
   -0.8000000000D+00    0.6000000000D+00    0.0000000000D+00   CY
    0.0000000000D+00    0.0000000000D+00    0.1000000000D+01   CZ
    0.2231524849D-03    0.2231586132D-03    0.5515340338D-03   SIGMA_PTG
"""


def read_text(tmp_path, text, read=read_summary, name="X.SUM"):
    path = tmp_path / name
    path.write_text(text)
    return read(path)


def written(value, tmp_path, write):
    path = tmp_path / "written"
    write(path, value)
    return path.read_text()


def test_every_field_in_si(tmp_path):
    image = read_text(tmp_path, GOOD)
    camera = image.camera
    assert (image.name, image.utc) == ("P600069148F2", "2019 MAR 03 11:22:33.456")
    assert (camera.width, camera.height, image.thresholds) == (1024, 1020, (500, 65535))
    assert camera.focal_length_mm == 135.68
    np.testing.assert_array_equal(camera.center, [511.7, 510.6])
    np.testing.assert_allclose(image.position, [1430.589240, 389.3115914, -845.8863431], rtol=1e-15)
    np.testing.assert_array_equal(image.axes, [[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
    np.testing.assert_array_equal(image.sun, [0.6, 0, 0.8])
    np.testing.assert_array_equal(camera.k_matrix, [[37.0371, 0.1240, 0], [-0.1240, -37.0371, 0]])
    np.testing.assert_array_equal(camera.distortion, [1e-4, 0, -2e-7, 0])
    np.testing.assert_allclose(image.scobj_sigma, [39.0702585, 36.96649938, 37.61399275])
    np.testing.assert_array_equal(
        image.pointing_sigma, [0.2231524849e-3, 0.2231586132e-3, 0.5515340338e-3]
    )
    assert image.landmarks == (
        ImagePoint("FA0115", 533.53, 475.22),
        ImagePoint("FC0098", 513.55, 501.38, deweighted=True),
    )
    assert image.limbs == (ImagePoint("GD0036", 493.55, -498.21, extra=("1.50",)),)


def test_written_as_read(tmp_path):
    assert written(read_text(tmp_path, GOOD), tmp_path, write_summary) == GOOD
    state = read_text(tmp_path, NOMINAL, read_nominal)
    assert written(state, tmp_path, write_nominal) == NOMINAL


@pytest.mark.real_data
def test_the_real_file_is_rewritten_byte_for_byte(shared_data, tmp_path):
    path = shared_data / "rosetta_67p" / "W48230079013.SUM"
    image = read_summary(path)
    assert image.name == "W48230079013"
    assert np.linalg.norm(image.position) == pytest.approx(170.7e3, rel=1e-3)
    write_summary(tmp_path / "again.SUM", image)
    assert (tmp_path / "again.SUM").read_bytes() == path.read_bytes()


def test_every_corrupted_line_is_seen(every_corruption_is_seen, tmp_path):
    every_corruption_is_seen(
        GOOD, read_summary, lambda image: written(image, tmp_path, write_summary), "X.SUM"
    )
    every_corruption_is_seen(
        NOMINAL, read_nominal, lambda state: written(state, tmp_path, write_nominal), "X.NOM"
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("P600069148F2\n", "P600069148F2X\n", r"line 1: image name .* 13 characters"),
        ("P600069148F2\n", "P600069148F2 L\n", r"line 1: .*line-scan"),
        ("P600069148F2\n", "../../passwd\n", r"line 1: .*slash"),
        ("2019 MAR 03", "2019 MAX 03", r"line 2: .*is not a time"),
        ("  1024  1020   500", "     0  1020   500", r"line 3: .*0 × 1020 pixels"),
        ("  1024  1020   500", "  10.5  1020   500", r"line 3: .*whole numbers"),
        ("   500 65535", " 65535   500", r"line 3: .*threshold"),
        ("0.1356800000D+03", "0.0000000000D+00", r"lines 3, 4 and 10: focal length"),
        ("0.1356800000D+03", "             NaN", r"line 4: .*'NaN'"),
        ("-0.1430589240D+01", "****************", r"line 5: .*\*\*\*"),
        ("-0.1430589240D+01", "-0.1430589240D+09", r"line 5: .*1.43059e\+08 km away.*metres"),
        ("0.1000000000D+01   CZ", "0.1100000000D+01   CZ", r"line 8: CZ has length 1.1"),
        ("0.1000000000D+01   CZ", "-0.100000000D+01   CZ", r"lines 6-8: .*left-handed"),
        ("0.6000000000D+00    0.0000000000D+00    0.8", "0.9D+00 0.0D+00 0.8", r"line 9: SZ"),
        ("37.0371    0.1240    0.0000", "0.0 0.1240 0.0", None),
        ("   37.0371    0.1240", "    0.0000    0.0000", r"K-matrix is singular"),
        ("DISTORTION", "DISTORTED", r"line 11: expected the line DISTORTION"),
        ("FC0098 ", "FA0115 ", r"line 16: FA0115 appears twice"),
        ("FC0098 ", "FC00981", r"line 16: landmark name"),
        ("   501.38 *", "", r"line 16: expected a name, a pixel and a line"),
        ("LIMB FITS", "LIMP FITS", r"line 17: 'LIMP FITS' is none of the headings"),
        ("LIMB FITS", "LANDMARKS", r"line 17: the heading LANDMARKS appears twice"),
        ("END FILE\n", "END FILE\nmore\n", r"line 20: something follows"),
        ("END FILE\n", "", r"line 19: the file ends where END FILE should be"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, old, new, message):
    assert old in GOOD
    text = GOOD.replace(old, new, 1)
    if message is None:
        assert read_text(tmp_path, text).camera.k_matrix[0, 0] == 0.0
        return
    with pytest.raises(FormatError, match=message) as caught:
        read_text(tmp_path, text)
    assert "X.SUM" in str(caught.value)


def test_older_forms_are_read(tmp_path):
    old = GOOD.replace(
        "    0.10000D-03    0.00000D+00   -0.20000D-06    0.00000D+00   DISTORTION",
        "    0.50000D+00                                                SIGPXL",
    )
    assert not read_text(tmp_path, old).camera.distortion.any()
    single = "    0.1000000000D-01" + " " * 43 + "SIG_PTG\n"
    lines = GOOD.splitlines(keepends=True)
    one = "".join([*lines[:12], single, "END FILE\n"])
    image = read_text(tmp_path, one)
    np.testing.assert_array_equal(image.pointing_sigma, [0.01, 0.01, 0.01])
    assert image.landmarks == image.limbs == ()


def test_unknown_sigmas_stay_unknown(tmp_path):
    image = dataclasses.replace(read_text(tmp_path, GOOD), scobj_sigma=np.full(3, np.nan))
    text = written(image, tmp_path, write_summary)
    assert "-0.1000000000D-02" in text or "-0.1000000000D+01" in text
    assert np.isnan(read_text(tmp_path, text).scobj_sigma).all()


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 5))
def test_round_trip_of_any_image(tmp_path_factory, seed, count):
    rng = np.random.default_rng(seed)
    sun = rng.normal(size=3)
    image = SpcImage(
        "N12345678901"[: rng.integers(1, 13)],
        "2018 NOV 08 01:02:03.250",
        Camera(
            rng.uniform(10, 3000),
            rng.uniform(0, 1000, 2),
            rng.normal(size=(2, 3)) * [100, 1, 0.01],
            *(int(n) for n in rng.integers(1, 5000, 2)),
            distortion=rng.normal(size=4) * 1e-4,
        ),
        rng.normal(size=3) * 1e5,
        Rotation.random(rng=rng).as_matrix(),
        sun / np.linalg.norm(sun),
        scobj_sigma=rng.uniform(0, 100, 3),
        pointing_sigma=rng.uniform(0, 1e-2, 3),
        landmarks=tuple(
            ImagePoint(f"AA{k:04d}", *rng.uniform(-999, 9999, 2).round(2), rng.random() < 0.5)
            for k in range(count)
        ),
    )
    path = tmp_path_factory.mktemp("sum") / "A.SUM"
    write_summary(path, image)
    back = read_summary(path)
    assert (back.name, back.utc, back.landmarks) == (image.name, image.utc, image.landmarks)
    for name in ("scobj", "axes", "sun", "scobj_sigma", "pointing_sigma"):
        value = getattr(image, name)
        np.testing.assert_allclose(getattr(back, name), value, rtol=5.01e-10, err_msg=name)
    for name in ("center", "k_matrix"):
        value = getattr(image.camera, name)
        np.testing.assert_allclose(getattr(back.camera, name), value, rtol=5.01e-10, err_msg=name)
    np.testing.assert_allclose(back.camera.distortion, image.camera.distortion, rtol=5.01e-5)
    first = path.read_bytes()
    write_summary(path, back)
    assert path.read_bytes() == first


def test_names_that_are_too_long_are_not_written(tmp_path):
    image = read_text(tmp_path, GOOD)
    long_name = dataclasses.replace(image, name="P600069148F2X")
    with pytest.raises(InvalidValueError, match="13 characters"):
        write_summary(tmp_path / "A", long_name)
    landmark = dataclasses.replace(image, landmarks=(ImagePoint("LONGNAME", 1, 2),))
    with pytest.raises(InvalidValueError, match="8 characters"):
        write_summary(tmp_path / "A", landmark)
    lens = dataclasses.replace(image.camera, distortion_model="brown", distortion=np.ones(3))
    with pytest.raises(InvalidValueError, match="coefficients, not 3"):
        write_summary(tmp_path / "A", dataclasses.replace(image, camera=lens))
    assert not (tmp_path / "A").exists()


def with_lens(tmp_path, model, values):
    image = read_text(tmp_path, GOOD)
    lens = dataclasses.replace(image.camera, distortion_model=model, distortion=np.array(values))
    return dataclasses.replace(image, camera=lens)


def test_a_camera_that_owens_model_reproduces_needs_no_file(tmp_path):
    # k1 of Brown's model is e2 f².
    image = with_lens(tmp_path, "brown", [-0.2, 0.0, 0.0, 0.0])
    write_summary(tmp_path / "A.SUM", image)
    back = read_summary(tmp_path / "A.SUM").camera
    assert back.distortion_model == "owen"
    np.testing.assert_allclose(back.distortion, [-0.2 / 135.68**2, 0, 0, 0], rtol=1e-4)
    assert not list(tmp_path.glob("CAMERA*"))


def test_any_other_camera_is_kept_exactly_next_to_the_file(tmp_path):
    image = with_lens(tmp_path, "brown", [-0.2, 0.5, 1e-3, -2e-3, 0.1])
    first, second = tmp_path / "A.SUM", tmp_path / "B.SUM"
    write_summary(first, image)
    (camera_file,) = tmp_path.glob("CAMERA-*.toml")
    back = read_summary(first)
    assert back.camera.distortion_model == "brown"
    for field in ("center", "k_matrix", "distortion"):
        np.testing.assert_array_equal(getattr(back.camera, field), getattr(image.camera, field))
    # Images with one camera share its file, and the layout of the old file is kept.
    write_summary(second, back, like=first)
    assert second.read_bytes() == first.read_bytes()
    assert list(tmp_path.glob("CAMERA-*.toml")) == [camera_file]
    # SPC's programs read up to END FILE: as good a camera as Owen's model can be.
    lines = first.read_text().splitlines(keepends=True)
    assert lines[-1].startswith(f"CAMERA {camera_file.name}, fitted above to ")
    (tmp_path / "spc").mkdir()
    fitted = read_text(tmp_path / "spc", "".join(lines[:-1])).camera
    apart = camera_difference(image.camera, fitted)
    assert f"{apart.rms_px:.3g} px rms, {apart.largest_px:.3g} px at most" in lines[-1]
    assert 0.01 < apart.largest_px < 0.5
    # They write the file without the line; in its folder it has its camera all the same.
    second.write_text("".join(lines[:-1]))
    assert read_summary(second).camera.distortion_model == "brown"


def test_an_image_without_its_exact_camera_is_refused(tmp_path):
    image = with_lens(tmp_path, "brown", [-0.2, 0.5, 1e-3, -2e-3, 0.1])
    path = tmp_path / "A.SUM"
    write_summary(path, image)
    (camera_file,) = tmp_path.glob("CAMERA-*.toml")
    text, camera = path.read_text(), camera_file.read_bytes()
    camera_file.write_bytes(camera.replace(b"-0.2", b"-0.3"))
    with pytest.raises(FormatError, match="is damaged, and the camera of "):
        read_summary(path)
    camera_file.unlink()
    with pytest.raises(FormatError, match=f"{camera_file.name}, which is not there"):
        read_summary(path)
    camera_file.write_bytes(camera)
    path.write_text(text.replace("0.1356800000D+03", "0.1357800000D+03"))
    with pytest.raises(FormatError, match="its camera is not the fit to"):
        read_summary(path)
    path.write_text(text.replace(camera_file.name, "../secret.toml"))
    with pytest.raises(FormatError, match="is no name of a camera file"):
        read_summary(path)


def test_nominal_fields_in_si(tmp_path):
    state = read_text(tmp_path, NOMINAL + "kept as it stands  1.0\n", read_nominal)
    assert isinstance(state, NominalState)
    np.testing.assert_allclose(state.velocity, [0.1, -0.2, 0.3], rtol=1e-15)
    np.testing.assert_allclose(state.scobj, [-1430.58924, -389.3115914, 845.8863431], rtol=1e-15)
    assert state.scobj_sigma[0] == pytest.approx(39.0702585)
    assert (state.sigma_frame, state.rest) == ("J2000", ("kept as it stands  1.0",))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.1000000000D-03", "0.1000000000D+05", r"line 2: .*10000 km/s; is it in m/s"),
        ("J2000", "SCOBJ", r"line 2: expected the velocity"),
        ("SIGMA_VSO", "SIGMA_PTG", r"line 4: expected the line SIGMA_VSO, found 'SIGMA_PTG'"),
    ],
)
def test_what_is_wrong_in_a_nominal_state_is_named(tmp_path, old, new, message):
    with pytest.raises(FormatError, match=message):
        read_text(tmp_path, NOMINAL.replace(old, new, 1), read_nominal)
