"""A camera as an instrument: its focal length as it varies, its pupil in the spacecraft."""

from spcola.camera.instrument.focal_length import FocusTable, ThermalFocus
from spcola.camera.instrument.instrument import Assumed, CameraAt, Instrument
from spcola.camera.instrument.pupil import Pupil

__all__ = ["Assumed", "CameraAt", "FocusTable", "Instrument", "Pupil", "ThermalFocus"]
