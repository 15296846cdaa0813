"""States of images in J2000, as navigation knows them: smooth errors along the trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import SpcImage, rotate_axes
from spcola.navigation import Spin
from spcola.truth.campaign.states import capped_deviation
from spcola.truth.campaign.stations import Station

_DAY = 86_400.0
ARC_GAP_S = 21_600.0
"""Images further apart in time belong to different arcs of the trajectory, seconds."""


@dataclass(frozen=True, eq=False)
class KernelState:
    """Nominal state of an image in J2000.

    Attributes
    ----------
    time : float
        Middle of the exposure, ephemeris time, s.
    arc : int
        Number of the arc of the trajectory, from 0.
    camera : str
        Name of the camera.
    position, velocity : (3,) ndarray
        Of the spacecraft relative to the body, metres and m/s.
    axes : (3, 3) ndarray
        Rows: Cx, Cy, Cz.
    position_error, pointing_error : (3,) ndarray
        Planted: nominal minus true position, metres; rotations about Cx, Cy, Cz, radians.
    """

    time: float
    arc: int
    camera: str
    position: FloatArray
    velocity: FloatArray
    axes: FloatArray
    position_error: FloatArray
    pointing_error: FloatArray


def inertial_sun(spin: Spin, sun: FloatArray, time: float) -> FloatArray:
    """Return the unit vector (3,) to the Sun in J2000.

    Parameters
    ----------
    spin : Spin
        Rotation of the body.
    sun : (3,) ndarray
        The same vector, body-fixed, at `time`.
    time : float
        Ephemeris time, s.
    """
    direction: FloatArray = sun @ spin.axes([time])[0]
    return direction


def nominal_states(
    stations: Sequence[Station],
    cameras: Sequence[str],
    truths: Sequence[SpcImage],
    spin: Spin,
    *,
    pointing_sigma: float,
    generator: np.random.Generator,
) -> list[KernelState]:
    """Return the nominal states of images in J2000, in the order of `stations`.

    Along an arc the error of the position changes smoothly from one deviation to another; both
    have at most the stations' nominal sigma, which a third of them reach (Weirich et al., section
    2.6). Pointing errors of different images are independent.

    Parameters
    ----------
    stations : sequence of Station
        In order of time.
    cameras : sequence of str
        Name of each camera.
    truths : sequence of SpcImage
        True states, body-fixed.
    spin : Spin
        The true rotation.
    pointing_sigma : float
        Of nominal pointing, about each camera axis, radians.
    generator : numpy.random.Generator
    """
    if not stations:
        return []
    times = np.array([station.time for station in stations])
    arcs = np.concatenate([[0], np.cumsum(np.diff(times) > ARC_GAP_S)]).astype(int)
    to_body = spin.axes(times)
    found = []
    for arc in range(int(arcs[-1]) + 1):
        inside = np.flatnonzero(arcs == arc)
        first, last = times[inside[0]], times[inside[-1]]
        ends = np.stack([capped_deviation(generator) for _ in range(2)])
        for k in inside.tolist():
            share = (times[k] - first) / max(last - first, 1.0)
            blend, rate = share * share * (3.0 - 2.0 * share), 6.0 * share * (1.0 - share)
            sigma = stations[k].nominal_sigma
            error = sigma * (ends[0] + blend * (ends[1] - ends[0]))
            drift = sigma * rate * (ends[1] - ends[0]) / max(last - first, 1.0)
            place, turn = stations[k].position, pointing_sigma * generator.normal(size=3)
            spun = np.cross([0.0, 0.0, spin.rate(float(times[k]))], place)
            found.append(
                KernelState(
                    float(times[k]), arc, cameras[k],
                    place @ to_body[k] + error,
                    (stations[k].velocity + spun) @ to_body[k] + drift,
                    rotate_axes(truths[k].axes @ to_body[k], turn), error, turn,
                )
            )  # fmt: skip
    return found


def true_spin(
    pole_deg: tuple[float, float], meridian_deg: float, period: float, epoch: float
) -> Spin:
    """Return the rotation of a body whose meridian is at `meridian_deg` at the `epoch`, s.

    Parameters
    ----------
    pole_deg : tuple of 2 float
        Right ascension and declination.
    meridian_deg : float
    period : float
        Of the rotation, s.
    epoch : float
        Ephemeris time, s.
    """
    rate = 360.0 * _DAY / period
    at_j2000 = (meridian_deg - rate * epoch / _DAY) % 360.0
    return Spin(*pole_deg, at_j2000, rate)
