"""A camera as an instrument: its pupil in the spacecraft, its focal length as it varies."""

from spcola.camera.instrument.pupil import Pupil

__all__ = ["Pupil"]
