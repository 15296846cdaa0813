"""Comparison of recovered with planted parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fusion.report.planted import RecoveredParameter
from fusion.truth.planted import Planted


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
    rotation = np.degrees(similarity.rotation_vector)
    return [
        *_rows("registration scale", similarity.scale, found, "scale"),
        *_rows("registration rotation", rotation, found, "rotation", "deg"),
        *_rows("registration translation", similarity.translation, found, "translation", "m"),
    ]


def _of_scale(planted: Planted, found: Mapping[str, Any]) -> list[RecoveredParameter]:
    """Rows of ``scale.json``, with the signs of :mod:`fusion.scaling.fit.observation`.

    With SPC's trajectory, spacecraft and surface are displaced alike, and there is no offset of
    the centre. With the reference trajectory the lidar surface is displaced by −T, and a relative
    range bias displaces it along the beam, not from the origin: the epsilon of a day with such a
    bias was not planted, and is left out.
    """
    shared = found.get("trajectory", "spc") == "spc"
    center = np.zeros(3) if shared else -planted.similarity.translation
    pole = planted.settings.rotation_deg[:2]
    rows = [
        *_rows("epsilon", planted.epsilon, found, "epsilon"),
        *_rows("size correction", planted.epsilon * _radius(found), found, "size_correction", "m"),
        *_rows("centre offset", center, found, "center_offset", "m"),
        *_rows("pole", pole, found, "pole", "deg"),
        *_rows("prime meridian", planted.prime_meridian_deg, found, "prime_meridian", "deg"),
        *_rows("range bias", planted.settings.lidar.range_bias, found, "range_bias", "m"),
    ]
    for day in found.get("per_day", ()):
        bias = planted.days.get(day["day"], float("nan"))
        if shared or bias == 0.0:
            rows += _rows(f"epsilon of {day['day']}", planted.epsilon + bias, day, "epsilon")
    return rows


def _rows(
    name: str, planted: ArrayLike, found: Mapping[str, Any], key: str, unit: str = ""
) -> list[RecoveredParameter]:
    """Read `key` and `key_sigma`, both followed by the unit: a number, or x, y, z of a vector."""
    tail = f"_{unit}" if unit else ""
    true = np.asarray(planted, dtype=np.float64)
    names = [f"{name} {axis}" for axis in "xyz"[: true.size]] if true.ndim else [name]
    # Null is NaN.
    values, sigmas = (
        np.broadcast_to(np.asarray(found.get(full), dtype=np.float64), true.shape or 1)
        for full in (f"{key}{tail}", f"{key}_sigma{tail}")
    )
    return [
        RecoveredParameter(*row, unit)
        for row in zip(names, true.ravel().tolist(), values.tolist(), sigmas.tolist(), strict=True)
    ]


def _radius(found: Mapping[str, Any]) -> float:
    """Return the mean radius with which a size correction was computed; NaN if unknown."""
    correction, epsilon = found.get("size_correction_m"), found.get("epsilon")
    return correction / epsilon if correction is not None and epsilon else float("nan")
