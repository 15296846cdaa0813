"""Cameras from the labels of ISIS cubes."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.camera.instrument import Assumed
from spcola.camera.projection import project_vectors
from spcola.errors import FormatError
from spcola.spice.instruments import read_cube_camera

NAC = "isis_cubes/M143947267L.cal.echo.crop.cub"
NAVCAM = "isis_cubes/20200303T213031S138_ncm_L0-reduced.cub"


def changed(shared_data, name, target, *changes):
    """A cube with other words of equal length in its label."""
    content = (shared_data / name).read_bytes()
    for old, new in changes:
        assert len(old) == len(new)
        assert content.count(old.encode()) == 1, old
        content = content.replace(old.encode(), new.encode())
    target.write_bytes(content)
    return target


@pytest.mark.real_data
def test_a_summed_nac_image_sees_the_same_ground(shared_data, tmp_path):
    # Two detector pixels in a sample of the original, of which the cube is an enlarged part.
    whole = read_cube_camera(shared_data / NAC).camera
    label = (
        ("AlphaSamples        = 5064", "AlphaSamples        = 2532"),
        ("AlphaStartingSample = 2999.5", "AlphaStartingSample = 1500.0"),
        ("AlphaEndingSample   = 3399.5", "AlphaEndingSample   = 1700.0"),
        ("SpatialSumming              = 1", "SpatialSumming              = 2"),
    )
    summed = read_cube_camera(changed(shared_data, NAC, tmp_path / "summed.cub", *label)).camera
    np.testing.assert_allclose(summed.center, whole.center, atol=1e-9)
    np.testing.assert_allclose(summed.k_matrix, whole.k_matrix, rtol=1e-12)
    first = ("SampleFirstPixel            = 0", "SampleFirstPixel            = 8")
    beyond = changed(shared_data, NAC, tmp_path / "beyond.cub", *label, first)
    with pytest.raises(FormatError, match="SampleFirstPixel 8 and 2532 samples"):
        read_cube_camera(beyond)
    narrow = changed(
        shared_data, NAC, tmp_path / "narrow.cub", label[3], first,
        (label[0][0], label[0][1].replace("2532", "2500")), *label[1:3],
    )  # fmt: skip
    np.testing.assert_allclose(
        read_cube_camera(narrow).camera.center, whole.center - [8.0, 0.0], atol=1e-9
    )


@pytest.mark.real_data
def test_navcam_has_its_focal_length_at_the_label_s_temperature(shared_data, tmp_path):
    found = read_cube_camera(shared_data / NAVCAM)
    cold = 1.0 - 2.2933e-5 * 28.89233
    assert not found.assumed
    assert found.camera.focal_length_mm == pytest.approx(7.64 * cold, rel=1e-9)
    unknown = changed(
        shared_data, NAVCAM, tmp_path / "unknown.cub", ("  CameraHeadTemp", "  CameraLostTemp")
    )
    nominal = read_cube_camera(unknown)
    assert nominal.assumed == (Assumed.NOMINAL_TEMPERATURE,)
    # At the corner of the frame: ISIS's u − cx is proportional to 1 + A T.
    ray = np.array([0.15, 0.1, 1.0])
    away = [np.array(project_vectors(one.camera, ray)) - one.camera.center
            for one in (found, nominal)]  # fmt: skip
    np.testing.assert_allclose(away[0], cold * away[1], rtol=1e-9)
