"""Stations: time, position, target and camera of each image."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.truth.campaign.cameras import framing_camera, looking
from spcola.truth.campaign.campaign import (
    DETAILED_SURVEY,
    FILL,
    NOMINAL_SIGMAS,
    CampaignSettings,
    Leg,
    place_of,
)
from spcola.truth.campaign.passes import Pass, PassSettings

_DAY = 86400.0
# Times have the precision of a .SUM file.
_DECIMALS = 3
# The plastic number's reciprocal: with its square it fills the plane most evenly (Roberts 2018).
_PLASTIC = 0.7548776662466927
PASS_PHASE = "P"
"""Phase of the images taken during a pass."""


@dataclass(frozen=True, eq=False)
class Station:
    """One image to be taken; all values are true, in the body-fixed frame.

    Attributes
    ----------
    name : str
        Name of the image: at most 12 characters.
    phase : str
        Code of the phase.
    time : float
        Ephemeris time, s, to the millisecond.
    position : (3,) ndarray
        Position of the spacecraft, metres.
    target : (3,) ndarray
        Point on the boresight, near its intersection with the ground (of a sphere), metres.
    camera : Camera
    nominal_sigma : float
        Sigma of the nominal position, metres.
    velocity : (3,) ndarray
        Rate of the position in the rotating frame, m/s.
    """

    name: str
    phase: str
    time: float
    position: FloatArray
    target: FloatArray
    camera: Camera
    nominal_sigma: float
    velocity: FloatArray


def plan_stations(campaign: CampaignSettings, passes: PassSettings) -> list[Station]:
    """Return the stations of a `campaign`, leg by leg, under the rotation and Sun of `passes`."""
    stations: list[Station] = []
    free: dict[int, float] = {}
    for number, leg in enumerate(campaign.legs, start=1):
        start = free.get(leg.day, campaign.epoch + leg.day * _DAY)
        free[leg.day] = start + leg.turns * passes.period
        stations.extend(_stations_of_leg(leg, number, start, campaign, passes))
    return stations


def stations_of_pass(
    at: Pass, per_pass: int, *, radius: float = 0.0, detector: int = 1024
) -> list[Station]:
    """Return the stations of a pass, from its first to its last moment.

    All point to O. The middle one has PolyCam, the others MapCam.

    Parameters
    ----------
    at : Pass
    per_pass : int
        Number of stations.
    radius : float
        Mean radius of the body, metres.
    detector : int
        Pixels across.
    """
    stations = []
    for number, share in enumerate(np.linspace(0.02, 0.98, per_pass)):
        time = round(at.start + share * at.duration, _DECIMALS)
        moment = np.array([time])
        position = at.position(moment)[0]
        camera = "PolyCam" if 2 * number + 1 == per_pass else "MapCam"
        stations.append(
            Station(
                f"P{at.number:02d}I{number + 1:02d}",
                PASS_PHASE,
                time,
                position,
                ground_toward(position, np.zeros(3), radius),
                framing_camera(camera, detector),
                NOMINAL_SIGMAS[DETAILED_SURVEY],
                at.velocity(moment)[0],
            )
        )
    return stations


def ground_toward(position: FloatArray, aim: FloatArray, radius: float) -> FloatArray:
    """Return the intersection (3,) of a sphere about O with the line from `position` to `aim`.

    Past the limb it is the point of the line nearest to O. All in metres.
    """
    along = (aim - position) / np.linalg.norm(aim - position)
    foot = position - (position @ along) * along
    half_chord = np.sqrt(max(radius**2 - float(foot @ foot), 0.0))
    return foot - half_chord * along


def _stations_of_leg(
    leg: Leg, number: int, start: float, campaign: CampaignSettings, passes: PassSettings
) -> Iterator[Station]:
    """Yield the stations of one leg, which begins at `start`, s."""
    camera = framing_camera(leg.camera, campaign.detector)
    first, last = (
        place_of(leg.local_times_h[end], leg.latitudes_deg[end], leg.ranges[end]) for end in (0, 1)
    )
    duration = leg.turns * passes.period
    spacing = (1.0 - campaign.overlap) * camera.width * camera.pixel_angle
    frames = _frames(leg, spacing * min(leg.ranges), campaign)
    steps = max(min(leg.steps, leg.images), -(-leg.images // len(frames)))
    step = duration / steps
    cadence = min(campaign.cadence, step / len(frames))
    for k, (at, frame) in enumerate(_part(steps, len(frames), leg.images)):
        time = round(start + at * step + frame * cadence, _DECIMALS)
        place = first + (last - first) * (time - start) / duration
        to_body = _turn(passes.sun_longitude(time))
        position = to_body @ place
        spin = 2.0 * np.pi / passes.period * np.array([position[1], -position[0], 0.0])
        yield Station(
            f"{leg.phase}{number:02d}I{k + 1:04d}",
            leg.phase,
            time,
            position,
            _target(position, frames[frame], spacing, leg, campaign.radius),
            camera,
            leg.nominal_sigma,
            to_body @ (last - first) / duration + spin,
        )


def _part(steps: int, frames: int, count: int) -> list[tuple[int, int]]:
    """Return `count` of all pairs of a step and a frame, in order, spread evenly over both.

    These are the pairs closest to 0 in Roberts' sequence in the plane, counted from the middle step
    and frame: a lattice, of which a smaller part is a coarser one, and a single pair the middle.
    """
    step, frame = np.divmod(np.arange(steps * frames), frames)
    turned = _PLASTIC * (step - steps // 2) + _PLASTIC**2 * (frame - frames // 2)
    off = np.abs((turned + 0.5) % 1.0 - 0.5)
    chosen = np.sort(np.argsort(off, kind="stable")[:count])
    return list(zip(step[chosen].tolist(), frame[chosen].tolist(), strict=True))


def _frames(leg: Leg, spacing: float, campaign: CampaignSettings) -> list[tuple[float, float]]:
    """Return the aims of the frames of a step, columns east and rows north of their middle.

    `spacing`, metres, is the smallest distance of neighbours.
    """
    rows = leg.rows
    if rows == FILL:
        rows = max(1, int(np.ceil(2.0 * campaign.radius / spacing)))
    columns = np.arange(leg.columns) - (leg.columns - 1) / 2.0
    return [(float(x), float(y)) for y in (rows - 1) / 2.0 - np.arange(rows) for x in columns]


def _target(
    position: FloatArray,
    frame: tuple[float, float],
    spacing: float,
    leg: Leg,
    radius: float,
) -> FloatArray:
    """Return the target (3,) of a frame, metres; `spacing` is an angle, radians."""
    distance = float(np.linalg.norm(position))
    # Ground seen at this angle from its normal is at this distance from the axis through O; the
    # line to it meets the plane through O a little further out.
    impact = radius * np.sin(np.radians(leg.off_nadir_deg))
    middle = impact / np.sqrt(1.0 - (impact / distance) ** 2)
    cx, cy, _ = looking(position, np.zeros(3))
    step = spacing * distance
    aim = (middle + step * frame[0]) * cx - step * frame[1] * cy
    return ground_toward(position, aim, radius)


def _turn(sun_longitude: float) -> FloatArray:
    """Return the rotation (3, 3) from places to the Sun to body-fixed ones."""
    cosine, sine = np.cos(sun_longitude), np.sin(sun_longitude)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
