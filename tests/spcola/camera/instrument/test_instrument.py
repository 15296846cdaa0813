from __future__ import annotations

import numpy as np
import pytest

from spcola.camera import Camera
from spcola.camera.instrument import Assumed, FocusTable, Instrument, Pupil, ThermalFocus
from spcola.errors import InvalidValueError

CAMERA = Camera(
    600.0, [512.5, 512.5], [[100, 0, 0], [0, 100, 0]], 1024, 1024, "owen", [1e-6, 0, 0, 0]
)
FOCUS = FocusTable(
    [0.0, 100.0, 200.0], [0.01, 0.004, 0.0], [590.0, 596.0, 600.0],
    [[3e-6, 0, 0, 0], [2e-6, 0, 0, 0], [1e-6, 0, 0, 0]],
)  # fmt: skip


def test_temperature_is_linear_about_its_reference() -> None:
    near = Instrument("MSI", CAMERA, ThermalFocus(20.0, -2e-5))
    assert near.at(temperature_c=20.0).camera.focal_length_mm == 600.0
    assert near.at(temperature_c=-30.0).camera.focal_length_mm == pytest.approx(600.6, rel=1e-14)
    assert near.at(temperature_c=-30.0).assumed == ()


def test_an_unknown_temperature_is_nominal_and_is_named() -> None:
    shot = Instrument("MSI", CAMERA, ThermalFocus(20.0, -2e-5)).at(range_m=100.0)
    assert shot.camera is CAMERA
    assert shot.assumed == (Assumed.NOMINAL_TEMPERATURE,)
    assert "temperature unknown" in shot.assumed[0].text
    assert Instrument("MSI", CAMERA).at().assumed == ()


def test_focus_by_motor_and_by_range() -> None:
    poly = Instrument("POLYCAM", CAMERA, focus=FOCUS)
    for shot in (poly.at(motor=50.0), poly.at(range_m=1 / 0.007), poly.at(motor=50.0, range_m=9e9)):
        assert shot.assumed == ()
        assert shot.camera.focal_length_mm == pytest.approx(593.0)
        np.testing.assert_allclose(shot.camera.distortion, [2.5e-6, 0, 0, 0])
    assert poly.at(range_m=np.inf).camera.focal_length_mm == 600.0
    assert poly.at().assumed == (Assumed.NOMINAL_FOCUS,)
    for shot in (poly.at(range_m=50.0), poly.at(motor=-1.0)):
        assert shot.assumed == (Assumed.END_OF_FOCUS_TABLE,)
        assert shot.camera.focal_length_mm == 590.0


def test_temperature_multiplies_the_focus() -> None:
    both = Instrument("X", CAMERA, ThermalFocus(0.0, 1e-4), FOCUS)
    assert both.at(temperature_c=10.0, motor=100.0).camera.focal_length_mm == pytest.approx(596.596)
    assert len(both.at().assumed) == 2


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: ThermalFocus(np.nan, 1e-5),
        lambda: ThermalFocus(0.0, 0.1),
        lambda: FocusTable([1.0, 2.0], [0.0, 0.1], [1.0, 2.0]),
        lambda: FocusTable([2.0, 1.0], [0.1, 0.0], [1.0, 2.0]),
        lambda: FocusTable([1.0, 2.0], [0.1, 0.0], [1.0, -2.0]),
        lambda: FocusTable([1.0], [0.1], [1.0]),
        lambda: Instrument("A", CAMERA, pupil=Pupil("B", [0, 0, 0])),
        lambda: Instrument("A", CAMERA, focus=FOCUS).at(range_m=-1.0),
    ],
)
def test_refuses(wrong) -> None:
    with pytest.raises(InvalidValueError):
        wrong()
