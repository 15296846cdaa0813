"""Positions of the spacecraft over the body: passes of its altimetry, stations of its images."""

from spcola.truth.campaign.campaign import CampaignSettings
from spcola.truth.campaign.passes import Pass, PassSettings, plan_passes
from spcola.truth.campaign.stations import Station, plan_stations, stations_of_pass

__all__ = [
    "CampaignSettings",
    "Pass",
    "PassSettings",
    "Station",
    "plan_passes",
    "plan_stations",
    "stations_of_pass",
]
