"""The images of a blind mission: true and nominal states, labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from fusion.truth.blind.close_ups import close_ups
from fusion.truth.blind.settings import BlindSettings
from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.errors import SettingsError
from spcola.navigation import Spin
from spcola.photometry.functions import photometric_function
from spcola.truth.body import stream
from spcola.truth.campaign import Station, plan_stations
from spcola.truth.campaign.states import true_state
from spcola.truth.kernels import (
    KernelState,
    MissionClock,
    inertial_sun,
    nominal_states,
    true_spin,
)
from spcola.truth.raw_frames import RawLabel

# Bright spots and slopes toward the Sun are this much brighter than level ground at its mirror
# point.
_BRIGHTER = 1.3
_LONG_FOCUS_MM = 300.0
# Names of images have milliseconds; attitudes around each image may not overlap.
_LEAST_STEP = 0.01
# The clock starts so long before the first image, s.
_DAY = 86_400.0
_BEFORE = 20 * _DAY


@dataclass(frozen=True, eq=False)
class BlindImage:
    """One image.

    Attributes
    ----------
    truth : SpcImage
        True state; its name is that of the product.
    label : RawLabel
    state : KernelState
        Nominal state.
    """

    truth: SpcImage
    label: RawLabel
    state: KernelState

    def planted(self) -> dict[str, Any]:
        """Return what is planted in it, besides its true state, in JSON types."""
        label = asdict(self.label)
        return {
            **label,
            "start_utc": self.label.start,
            "kernel_position_error_m": self.state.position_error.tolist(),
            "kernel_pointing_error_rad": self.state.pointing_error.tolist(),
        }


@dataclass(frozen=True, eq=False)
class BlindPlan:
    """Images, rotations and clock of a mission.

    Attributes
    ----------
    images : tuple of BlindImage
        In order of time.
    spin, nominal_spin : Spin
        True and nominal rotation.
    sun : (3,) ndarray
        Unit vector to the Sun in J2000.
    clock : MissionClock
    """

    images: tuple[BlindImage, ...]
    spin: Spin
    nominal_spin: Spin
    sun: FloatArray
    clock: MissionClock


def plan_blind(settings: BlindSettings) -> BlindPlan:
    """Return the images of a mission, their states and labels.

    Raises
    ------
    SettingsError
        If two images are taken at one time.
    """
    stations = blind_stations(settings)
    times = np.array([station.time for station in stations])
    if (np.diff(times) < _LEAST_STEP).any():
        raise SettingsError(
            "two images are less than 10 ms apart", "campaign", "change days or turns of its legs"
        )
    passes, rotation = settings.passes, settings.rotation
    spin = true_spin(rotation.pole_deg, rotation.meridian_deg, passes.period, passes.epoch)
    clock = MissionClock(float(np.floor(times.min(initial=passes.epoch) - _BEFORE)))
    labels = [_label(station, settings, clock) for station in stations]
    truths = [
        replace(
            true_state(station, passes.sun(station.time), settings.states, settings.detector.bits),
            name=label.product,
        )
        for station, label in zip(stations, labels, strict=True)
    ]
    states = nominal_states(
        stations, [label.camera for label in labels], truths, spin,
        pointing_sigma=settings.states.nominal_pointing_sigma,
        generator=stream(settings.seed, "kernels"),
    )  # fmt: skip
    images = tuple(map(BlindImage, truths, labels, states))
    sun = inertial_sun(spin, passes.sun(passes.epoch), passes.epoch)
    return BlindPlan(images, spin, _nominal(spin, settings, times), sun, clock)


def blind_stations(settings: BlindSettings) -> list[Station]:
    """Return the stations of all images, in order of time."""
    stations = plan_stations(settings.campaign, settings.passes)
    if settings.close_ups:
        stations += close_ups(settings, stations)
    return sorted(stations, key=lambda station: station.time)


def _label(station: Station, settings: BlindSettings, clock: MissionClock) -> RawLabel:
    """Return the label of an image; exposures are set by the phase angle."""
    camera = "PolyCam" if station.camera.focal_length_mm > _LONG_FOCUS_MM else "MapCam"
    toward = station.position / np.linalg.norm(station.position)
    phase = float(np.arccos(np.clip(toward @ settings.passes.sun(station.time), -1.0, 1.0)))
    mirror = np.array([np.cos(0.5 * phase)])
    shade = photometric_function(settings.imaging.photometry)(mirror, mirror, np.array([phase]))
    iof = _BRIGHTER * settings.body.mean_albedo * float(shade[0])
    exposure = settings.detector.exposure_for(iof, camera)
    return RawLabel(
        camera, station.phase, station.time, exposure,
        settings.detector.temperature_at(station.time), clock.text(station.time - 0.5 * exposure),
    )  # fmt: skip


def _nominal(spin: Spin, settings: BlindSettings, times: Sequence[float] | FloatArray) -> Spin:
    """Return the nominal rotation: its meridian has the stated error in the middle of the times."""
    rotation = settings.rotation
    middle = float(np.mean(times)) if len(times) else settings.passes.epoch
    drift = rotation.rate_error_deg_per_day * middle / _DAY
    return replace(
        spin,
        pole_ra_deg=spin.pole_ra_deg + rotation.pole_error_deg[0],
        pole_dec_deg=spin.pole_dec_deg + rotation.pole_error_deg[1],
        meridian_deg=spin.meridian_deg + rotation.meridian_error_deg - drift,
        rate_deg_per_day=spin.rate_deg_per_day + rotation.rate_error_deg_per_day,
    )
