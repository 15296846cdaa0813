"""Positions and pointing of the spacecraft: passes, stations, cameras, states."""

from spcola.truth.campaign.campaign import CampaignSettings
from spcola.truth.campaign.passes import Pass, PassSettings, day_of, plan_passes
from spcola.truth.campaign.states import SolvedState, StateSettings, make_state, true_state
from spcola.truth.campaign.stations import Station, plan_stations, stations_of_pass

__all__ = [
    "CampaignSettings",
    "Pass",
    "PassSettings",
    "SolvedState",
    "StateSettings",
    "Station",
    "day_of",
    "make_state",
    "plan_passes",
    "plan_stations",
    "stations_of_pass",
    "true_state",
]
