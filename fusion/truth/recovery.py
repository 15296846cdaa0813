"""Planted against recovered: the only reader of the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.truth.planted import Planted
from spcola.arrays import BoolArray, FloatArray
from spcola.maplet import Maplet
from spcola.truth.body import TruthBody
from spcola.truth.light import LightMap
from spcola.truth.sampled import SampledSurface
from spcola.truth.solution import heights_in_frame

# What casts shadows on the light map is resolved to this, metres.
_LIGHT_SPACING = 1.0


@dataclass(frozen=True)
class Recovered:
    """One planted value and what was found of it.

    Attributes
    ----------
    name : str
    planted, recovered, sigma : float
        In `unit`; NaN where nothing was found.
    unit : str
        Empty if dimensionless.
    """

    name: str
    planted: float
    recovered: float
    sigma: float
    unit: str

    @property
    def pull(self) -> float:
        """(recovered − planted) / sigma; NaN without a sigma."""
        if not self.sigma > 0:
            return float("nan")
        return (self.recovered - self.planted) / self.sigma


@dataclass(frozen=True)
class RegionErrors:
    """Errors of heights in one region: their number, mean, rms, and calibration, metres.

    `pull_std` is the standard deviation of error / sigma: 1 where the sigmas are right.
    `within_1`, `within_2` are the shares of errors within one and two sigma.
    """

    region: str
    count: int
    mean: float
    rms: float
    pull_std: float
    within_1: float
    within_2: float


def compare(
    planted: Planted, registration: Mapping[str, Any], scale: Mapping[str, Any]
) -> list[Recovered]:
    """Return planted and recovered values side by side.

    Parameters
    ----------
    planted : Planted
    registration : mapping
        Content of ``registration.json``; empty if there is none.
    scale : mapping
        Content of ``scale.json``; empty if there is none.
    """
    return [*_of_registration(planted, registration), *_of_scale(planted, scale)]


def _of_registration(planted: Planted, found: Mapping[str, Any]) -> list[Recovered]:
    similarity = planted.similarity
    rows = [_row("registration scale", similarity.scale, found, "scale", "")]
    rotation = np.degrees(similarity.rotation_vector)
    rows += _rows("registration rotation", rotation, found, ("rotation", "deg"))
    rows += _rows("registration translation", similarity.translation, found, ("translation", "m"))
    return rows


def _of_scale(planted: Planted, found: Mapping[str, Any]) -> list[Recovered]:
    """Rows of ``scale.json``, as its :mod:`fusion.scaling.observation` defines the signs.

    With SPC's trajectory spacecraft and surface are displaced alike, and no offset of the centre
    is to be seen; with the reference trajectory the lidar surface lies off by −T.
    """
    rows = [_row("epsilon", planted.epsilon, found, "epsilon", "")]
    radius = _ratio(found, "size_correction_m", "epsilon")
    rows.append(_row("size correction", planted.epsilon * radius, found, "size_correction", "m"))
    shared = found.get("trajectory", "spc") == "spc"
    center = np.zeros(3) if shared else -planted.similarity.translation
    rows += _rows("centre offset", center, found, ("center_offset", "m"))
    rows.append(_row("prime meridian", planted.prime_meridian_deg, found, "prime_meridian", "deg"))
    for day in found.get("per_day", ()):
        expected = planted.epsilon + planted.days.get(day["day"], float("nan"))
        rows.append(_row(f"epsilon of {day['day']}", expected, day, "epsilon", ""))
    return rows


def _row(name: str, planted: float, found: Mapping[str, Any], key: str, unit: str) -> Recovered:
    """Read `key` and `key_sigma`, with the unit behind both, from `found`."""
    tail = f"_{unit}" if unit else ""
    value = found.get(f"{key}{tail}")
    sigma = found.get(f"{key}_sigma{tail}")
    return Recovered(name, float(planted), _number(value), _number(sigma), unit)


def _rows(
    name: str, planted: Sequence[float] | FloatArray, found: Mapping[str, Any], key: tuple[str, str]
) -> list[Recovered]:
    """Read the three components of a vector."""
    base, unit = key
    value = found.get(f"{base}_{unit}") or [None] * 3
    sigma = found.get(f"{base}_sigma_{unit}") or [None] * 3
    return [
        Recovered(f"{name} {axis}", float(planted[k]), _number(value[k]), _number(sigma[k]), unit)
        for k, axis in enumerate("xyz")
    ]


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _ratio(found: Mapping[str, Any], above: str, below: str) -> float:
    """Return the mean radius that a size correction was made with."""
    denominator = _number(found.get(below))
    return _number(found.get(above)) / denominator if denominator else float("nan")


def height_errors(maplet: Maplet, body: TruthBody, planted: Planted) -> FloatArray:
    """Return the errors (2q+1, 2q+1) of a maplet's heights along its Uz, metres.

    The maplet is in SPC coordinates; the truth is brought there by the planted similarity. NaN
    where the maplet has no height.
    """
    truth = heights_in_frame(body, maplet.grid, planted.similarity)
    errors: FloatArray = maplet.height - truth
    return errors


def shadowed(maplet: Maplet, planted: Planted, light: LightMap) -> BoolArray:
    """Return which points (2q+1, 2q+1) of a maplet lie where SPC saw nothing, or hardly."""
    places = planted.similarity.inverse().apply(maplet.points()).reshape(-1, 3)
    dark: BoolArray = light.at(places) < planted.settings.solution.darkness.dark
    return dark.reshape(maplet.grid.shape)


def assess_heights(
    maplets: Sequence[Maplet], body: TruthBody, planted: Planted
) -> list[RegionErrors]:
    """Return the height errors of maplets in SPC coordinates: all, lit and shadowed ground."""
    errors, sigmas, dark = [], [], []
    latitude = np.radians(planted.settings.passes.sun_latitude_deg)
    light = LightMap.of(SampledSurface(body, _LIGHT_SPACING), sun_latitude=latitude)
    for maplet in maplets:
        known = maplet.valid
        errors.append(height_errors(maplet, body, planted)[known])
        sigmas.append(maplet.sigma[known])
        dark.append(shadowed(maplet, planted, light)[known])
    error, sigma, shade = (np.concatenate(part) for part in (errors, sigmas, dark))
    known = np.isfinite(error)
    lit = np.logical_not(shade)
    regions = {"all": known, "lit": known & lit, "shadowed": known & np.logical_not(lit)}
    return [_region(name, error[mask], sigma[mask]) for name, mask in regions.items()]


def _region(name: str, error: FloatArray, sigma: FloatArray) -> RegionErrors:
    if not len(error):
        return RegionErrors(name, 0, *[float("nan")] * 5)
    with np.errstate(divide="ignore", invalid="ignore"):
        pull = (error / sigma)[sigma > 0]
    spread = float(np.std(pull)) if len(pull) else float("nan")
    shares = [float(np.mean(np.abs(pull) < k)) if len(pull) else float("nan") for k in (1, 2)]
    rms = float(np.sqrt(np.mean(error**2)))
    return RegionErrors(name, len(error), float(np.mean(error)), rms, spread, *shares)
