"""Names and NAIF numbers in the labels and kernels of a blind mission."""

from __future__ import annotations

from collections.abc import Mapping

MISSION, CRAFT, TARGET = "SPCOLA BLIND MISSION", "BLINDCRAFT", "BLINDBODY"
"""Names of the mission, its spacecraft and its target."""
SPACECRAFT, BODY, CLOCK = -777, 2777777, -777
"""NAIF numbers of the spacecraft, the body and the spacecraft's clock."""
BUS = -777000
"""Number of the frame of the spacecraft, whose attitude the CK states."""
INSTRUMENTS: Mapping[str, int] = {"MapCam": -777020, "PolyCam": -777010}
"""Numbers of the cameras and of their frames."""
