"""Comparison of recovered with planted parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fusion.report.planted import RecoveredParameter
from fusion.truth.planted import Planted
from spcola.arrays import FloatArray


def compare(
    planted: Planted, registration: Mapping[str, Any], scale: Mapping[str, Any]
) -> list[RecoveredParameter]:
    """Return planted and recovered values.

    Parameters
    ----------
    planted : Planted
    registration : mapping
        Content of ``registration.json``; empty if there is none.
    scale : mapping
        Content of ``scale.json``; empty if there is none.
    """
    return [*_of_registration(planted, registration), *_of_scale(planted, scale)]


def _of_registration(planted: Planted, found: Mapping[str, Any]) -> list[RecoveredParameter]:
    similarity = planted.similarity
    rows = [_row("registration scale", similarity.scale, found, "scale", "")]
    rotation = np.degrees(similarity.rotation_vector)
    rows += _rows("registration rotation", rotation, found, ("rotation", "deg"))
    rows += _rows("registration translation", similarity.translation, found, ("translation", "m"))
    return rows


def _of_scale(planted: Planted, found: Mapping[str, Any]) -> list[RecoveredParameter]:
    """Rows of ``scale.json``, with the signs of :mod:`fusion.scaling.fit.observation`.

    With SPC's trajectory, spacecraft and surface are displaced alike, and there is no offset of
    the centre. With the reference trajectory the lidar surface is displaced by −T, and a relative
    range bias displaces it along the beam, not from the origin: the epsilon of a day with such a
    bias was not planted, and is left out.
    """
    rows = [_row("epsilon", planted.epsilon, found, "epsilon", "")]
    radius = _ratio(found, "size_correction_m", "epsilon")
    rows.append(_row("size correction", planted.epsilon * radius, found, "size_correction", "m"))
    shared = found.get("trajectory", "spc") == "spc"
    center = np.zeros(3) if shared else -planted.similarity.translation
    rows += _rows("centre offset", center, found, ("center_offset", "m"))
    rows += _rows("pole", planted.settings.rotation_deg[:2], found, ("pole", "deg"))
    rows.append(_row("prime meridian", planted.prime_meridian_deg, found, "prime_meridian", "deg"))
    rows.append(_row("range bias", planted.settings.lidar.range_bias, found, "range_bias", "m"))
    for day in found.get("per_day", ()):
        bias = planted.days.get(day["day"], float("nan"))
        if shared or bias == 0.0:
            expected = planted.epsilon + bias
            rows.append(_row(f"epsilon of {day['day']}", expected, day, "epsilon", ""))
    return rows


def _row(
    name: str, planted: float, found: Mapping[str, Any], key: str, unit: str
) -> RecoveredParameter:
    """Read `key` and `key_sigma`, both followed by the unit, from `found`."""
    tail = f"_{unit}" if unit else ""
    value = found.get(f"{key}{tail}")
    sigma = found.get(f"{key}_sigma{tail}")
    return RecoveredParameter(name, float(planted), _number(value), _number(sigma), unit)


def _rows(
    name: str, planted: Sequence[float] | FloatArray, found: Mapping[str, Any], key: tuple[str, str]
) -> list[RecoveredParameter]:
    """Read as many of the components x, y, z of a vector as were planted."""
    base, unit = key
    value = found.get(f"{base}_{unit}") or [None] * 3
    sigma = found.get(f"{base}_sigma_{unit}") or [None] * 3
    return [
        RecoveredParameter(
            f"{name} {axis}", float(planted[k]), _number(value[k]), _number(sigma[k]), unit
        )
        for k, axis in enumerate("xyz"[: len(planted)])
    ]


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _ratio(found: Mapping[str, Any], above: str, below: str) -> float:
    """Return the mean radius with which a size correction was computed."""
    denominator = _number(found.get(below))
    return _number(found.get(above)) / denominator if denominator else float("nan")
