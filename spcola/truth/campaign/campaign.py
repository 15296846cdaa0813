"""Imaging campaigns: the legs of a synthetic spacecraft that takes images, by phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError
from spcola.truth.campaign.cameras import LEAST_DETECTOR

APPROACH, PRELIMINARY_SURVEY, DETAILED_SURVEY = "AP", "PS", "DS"
"""Codes of the phases, the first letters of their images' names."""

NOMINAL_SIGMAS = {APPROACH: 400.0, PRELIMINARY_SURVEY: 100.0, DETAILED_SURVEY: 6.4}
"""Errors of nominal positions, metres (Weirich et al., section 2.3)."""

BENNU_RADIUS = 245.0
"""Mean radius, metres, of the body of the planned phases."""

FILL = 0
"""Value for the number of rows: as many as cover the body's disc."""

_DAY = 86400.0
_POLAR_LATITUDE = 80.0
# From its closest point, 8.9 km from O, a straight pass is 11.1 km away after 36.7° (Table 1).
_CLOSEST, _POLAR_REACH_DEG = 8900.0, 36.7
# Share of a polar pass, about its closest point, taken with MapCam; and of its images.
_MAPCAM_PART, _MAPCAM_IMAGES = 0.1, 0.05


@dataclass(frozen=True)
class Leg:
    """Images taken on one straight path past the body, or from one place.

    Places are relative to the Sun: the body rotates under them. Pairs are those of the first and of
    the last moment; equal ones make a fixed station.

    Parameters
    ----------
    phase : str
        Code of the phase, two letters.
    day : int
        Day of the campaign; legs of a day follow each other.
    images : int
        Number of images: an even selection from the frames of all steps, if it is less than all.
    camera : str
        A name for :func:`spcola.truth.campaign.cameras.framing_camera`.
    local_times_h, latitudes_deg, ranges : tuple of 2 float
        Local solar time and latitude under the spacecraft, hours and degrees; distance from O,
        metres.
    turns : float
        Duration, in rotations of the body.
    steps : int
        Moments with planned frames; there are more of them where `images` requires it.
    columns, rows : int
        Frames side by side at each step: a grid about the centre, or with
        `rows` = :data:`FILL` a sweep from north to south over the whole disc.
    off_nadir_deg : float
        The frames lie at a distance from the centre of the disc at which the ground (of a sphere)
        is seen at this angle from its normal: to the east, or the west if negative.
    nominal_sigma : float
        Sigma of nominal positions, metres.
    """

    phase: str
    day: int
    images: int
    camera: str
    local_times_h: tuple[float, float]
    latitudes_deg: tuple[float, float]
    ranges: tuple[float, float]
    turns: float = 1.0
    steps: int = 36
    columns: int = 1
    rows: int = 1
    off_nadir_deg: float = 0.0
    nominal_sigma: float = 6.4

    def __post_init__(self) -> None:
        if self.images < 0 or self.steps < 1 or self.columns < 1 or self.rows < FILL:
            raise SettingsError("needs images, steps and frames ≥ 0", f"leg of {self.phase}")
        if not (self.turns > 0 and min(self.ranges) > 0 and self.nominal_sigma >= 0):
            raise SettingsError("duration, range or sigma out of range", f"leg of {self.phase}")
        if max(map(abs, self.latitudes_deg)) > 90 or not abs(self.off_nadir_deg) < 80:
            raise SettingsError("latitude or off-nadir angle out of range", f"leg of {self.phase}")


@dataclass(frozen=True)
class CampaignSettings:
    """All images of a campaign except those of the passes.

    Parameters
    ----------
    legs : tuple of Leg
    radius : float
        Mean radius of the body, metres.
    detector : int
        Pixels across a camera's detector.
    epoch : float
        Ephemeris time at which day 0 begins, s (2019 JUN 01 00:00 UTC).
    cadence : float
        Largest interval between the frames of one step, s.
    overlap : float
        Share of the field of view by which neighbouring frames overlap.
    """

    legs: tuple[Leg, ...] = ()
    radius: float = BENNU_RADIUS
    detector: int = 1024
    epoch: float = 612_619_269.184
    cadence: float = 20.0
    overlap: float = 0.1

    def __post_init__(self) -> None:
        if not (self.radius > 0 and self.cadence > 0 and 0 <= self.overlap < 0.9):
            raise SettingsError("radius, cadence or overlap out of range", "imaging campaign")
        # A camera refuses it too, but only after all the scans have been made.
        if self.detector < LEAST_DETECTOR:
            raise SettingsError(
                f"needs at least {LEAST_DETECTOR} pixels across, not {self.detector}", "detector"
            )
        if any(min(leg.ranges) <= self.radius for leg in self.legs):
            raise SettingsError("a leg begins or ends inside the body", "imaging campaign")

    @property
    def images(self) -> int:
        """Number of images."""
        return sum(leg.images for leg in self.legs)

    @classmethod
    def of_phases(
        cls,
        *,
        approach: int = 927,
        preliminary_survey: int = 877,
        detailed_survey: int = 3265,
        radius: float = BENNU_RADIUS,
        detector: int = 1024,
    ) -> CampaignSettings:
        """Return the campaign of Weirich et al. (section 2.5, Table 1) with so many images.

        Around a body of another radius all ranges change in proportion, so that its apparent size
        is the same; nominal errors are unchanged.

        Parameters
        ----------
        approach, preliminary_survey, detailed_survey : int
            Images of each phase.
        radius : float
            Of the body, metres.
        detector : int
            Pixels along a side.
        """
        legs = (
            *approach_legs(approach),
            *preliminary_survey_legs(preliminary_survey),
            *detailed_survey_legs(detailed_survey),
        )
        factor = radius / BENNU_RADIUS
        scaled = (
            replace(leg, ranges=(factor * leg.ranges[0], factor * leg.ranges[1]))
            for leg in legs
            if leg.images
        )
        return cls(tuple(scaled), radius, detector)


def approach_legs(images: int = 927) -> tuple[Leg, ...]:
    """Return nine days of approach, 140.5 to 30 km over the equator, phase angle 4° to 41°.

    PolyCam follows one rotation a day in steps of 10°: five days in single frames, three in
    grids of 2 × 2, one of 3 × 3. In the last two days the spacecraft drifts north.
    """
    shares = _shared(images, [36.0] * 5 + [144.0] * 3 + [315.0])
    sides = [1] * 5 + [2] * 3 + [3]
    legs = []
    for day, (count, side) in enumerate(zip(shares, sides, strict=True)):
        # A rotation takes some 0.18 of a day; the path continues through the rest of it.
        way = np.array([day, day + 0.18]) / 8.18
        legs.append(
            Leg(
                APPROACH,
                day,
                count,
                "PolyCam",
                _pair(12.0 + (4.0 + 36.0 * way) / 15.0),
                _pair(10.0 * np.clip(way * 8.18 - 6.18, 0.0, 2.0) / 2.0),
                _pair(140_500.0 - 110_500.0 * way),
                columns=side,
                rows=side,
                nominal_sigma=NOMINAL_SIGMAS[APPROACH],
            )
        )
    return tuple(legs)


def preliminary_survey_legs(images: int = 877) -> tuple[Leg, ...]:
    """Return the passes of the north pole, the equator and the south pole, 8.9 to 11.1 km.

    PolyCam sweeps from north to south; around the closest points to the poles MapCam images the
    whole disc. The northern pass runs from east to west, the others from west to east. Phase
    angles are 37° to 92°.
    """
    north, middle, south = _shared(images, [807.0, 591.0, 723.0])
    # From O the equatorial pass spans phase angles of 92° to 37°, morning side.
    reach = np.radians((92.0 - 37.0) / 2.0)
    equatorial = Leg(
        PRELIMINARY_SURVEY,
        12,
        middle,
        "PolyCam",
        (12.0 - 92.0 / 15.0, 12.0 - 37.0 / 15.0),
        (0.0, 0.0),
        (_CLOSEST / float(np.cos(reach)),) * 2,
        steps=49,
        rows=FILL,
        nominal_sigma=NOMINAL_SIGMAS[PRELIMINARY_SURVEY],
    )
    return (
        *_polar_pass(10, north, _POLAR_LATITUDE, heading=-1.0),
        equatorial,
        *_polar_pass(14, south, -_POLAR_LATITUDE, heading=1.0),
    )


def detailed_survey_legs(images: int = 3265) -> tuple[Leg, ...]:
    """Return the stations of the Baseball Diamond, 3.8 km: four north, four south.

    Either hemisphere is seen from its middle latitudes at local times of 10:00 and 12:30, each for
    one rotation about nadir and one off nadir, with a stereo angle of 15°; PolyCam sweeps from
    north to south. Phase angles are 44° to 52°.
    """
    places = [(10.0, 38.0), (12.5, 46.0)]
    stations = [
        (local_time_h, side * latitude, off_nadir_deg)
        for side in (1.0, -1.0)
        for local_time_h, latitude in places
        for off_nadir_deg in (0.0, 15.0)
    ]
    shares = _shared(images, [1.0] * len(stations))
    return tuple(
        Leg(
            DETAILED_SURVEY,
            18 + number,
            shares[number],
            "PolyCam",
            (local_time_h,) * 2,
            (latitude,) * 2,
            (3800.0, 3800.0),
            steps=38,
            rows=FILL,
            off_nadir_deg=off_nadir_deg,
            nominal_sigma=NOMINAL_SIGMAS[DETAILED_SURVEY],
        )
        for number, (local_time_h, latitude, off_nadir_deg) in enumerate(stations)
    )


def place_of(local_time_h: float, latitude_deg: float, distance: float) -> FloatArray:
    """Return a place (3,), metres, relative to the Sun: x at local noon, y at 18 h."""
    longitude, latitude = np.radians(15.0 * (local_time_h - 12.0)), np.radians(latitude_deg)
    ring = np.cos(latitude)
    direction = [ring * np.cos(longitude), ring * np.sin(longitude), np.sin(latitude)]
    return distance * np.array(direction)


def _polar_pass(day: int, images: int, latitude_deg: float, *, heading: float) -> list[Leg]:
    """Return the three legs of a pass of a pole: PolyCam, MapCam, PolyCam.

    `heading` is 1 from west to east, −1 from east to west, as seen by the Sun.
    """
    closest = place_of(12.0, latitude_deg, _CLOSEST)
    along = np.array([0.0, heading * _CLOSEST * np.tan(np.radians(_POLAR_REACH_DEG)), 0.0])
    cuts = (0.0, 0.5 - _MAPCAM_PART / 2.0, 0.5 + _MAPCAM_PART / 2.0, 1.0)
    side = (1.0 - _MAPCAM_IMAGES) / 2.0
    shares = _shared(images, [side, _MAPCAM_IMAGES, side])
    legs = []
    for number, camera in enumerate(("PolyCam", "MapCam", "PolyCam")):
        first, last = cuts[number], cuts[number + 1]
        ends = [closest + (2.0 * cut - 1.0) * along for cut in (first, last)]
        legs.append(
            Leg(
                PRELIMINARY_SURVEY,
                day,
                shares[number],
                camera,
                _pair([12.0 + _degrees(x[1], x[0]) / 15.0 for x in ends]),
                _pair([_degrees(x[2], np.hypot(x[0], x[1])) for x in ends]),
                _pair([float(np.linalg.norm(x)) for x in ends]),
                turns=last - first,
                steps=16 if camera == "MapCam" else 32,
                rows=1 if camera == "MapCam" else FILL,
                nominal_sigma=NOMINAL_SIGMAS[PRELIMINARY_SURVEY],
            )
        )
    return legs


def _shared(total: int, weights: Sequence[float]) -> list[int]:
    """Divide `total` by weight into whole numbers with the same sum."""
    ends = np.round(total * np.cumsum(weights) / np.sum(weights)).astype(int)
    return [int(count) for count in np.diff(ends, prepend=0)]


def _pair(values: Sequence[float] | FloatArray) -> tuple[float, float]:
    """Return two values as plain numbers."""
    first, last = values
    return float(first), float(last)


def _degrees(opposite: float, adjacent: float) -> float:
    return float(np.degrees(np.arctan2(opposite, adjacent)))
