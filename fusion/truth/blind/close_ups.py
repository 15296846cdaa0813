"""Frames of the complete detailed survey that show a site of fine ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fusion.truth.blind.settings import BlindSettings
from spcola.arrays import FloatArray
from spcola.truth.campaign import CampaignSettings, Station, plan_stations
from spcola.truth.campaign.cameras import looking

# The site's middle lies within this share of half the frame, is seen at most 60° from its normal,
# and has the Sun at least 10° high (of a sphere).
_INSIDE, _LEAST_FACING, _LEAST_HIGH = 0.8, 0.5, 0.17
# Another frame within this time is taken instead, s.
_SAME_MOMENT = 1.0


def close_ups(settings: BlindSettings, taken: Sequence[Station]) -> list[Station]:
    """Return the frames of the complete detailed survey that show a fine site, and are not `taken`.

    A survey that is thinned evenly shows a place once or twice at its best resolution: too little
    for photoclinometry.
    """
    campaign = CampaignSettings.of_phases(
        approach=0, preliminary_survey=0,
        radius=settings.body.radius, detector=settings.campaign.detector,
    )  # fmt: skip
    sites = np.array([site.direction for site in settings.solid.sites]).reshape(-1, 3)
    times = np.array([station.time for station in taken])
    return [
        station
        for station in plan_stations(campaign, settings.passes)
        if _shows(station, settings, sites)
        and not (np.abs(times - station.time) < _SAME_MOMENT).any()
    ]


def _shows(station: Station, settings: BlindSettings, sites: FloatArray) -> bool:
    """Return whether a frame shows the middle of one of the sites (S, 3), lit."""
    away = settings.body.radius * sites - station.position
    x, y, z = looking(station.position, station.target) @ away.T
    half = 0.5 * station.camera.width * station.camera.pixel_angle
    facing = -np.sum(away * sites, axis=1) / np.sqrt(np.sum(away**2, axis=1))
    shown = np.maximum(np.abs(x), np.abs(y)) < _INSIDE * half * z
    lit = sites @ settings.passes.sun(station.time) > _LEAST_HIGH
    return bool((shown & (facing > _LEAST_FACING) & lit).any())
