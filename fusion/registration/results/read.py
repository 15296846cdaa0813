"""Registrations read from ``registration.json``: the transform, its covariance, each mapola."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusion.registration.transform import KnownTransform
from fusion.registration.transform.known import known_transform
from fusion.registration.transform.parameters import LIDAR_FRAME, SPC_FRAME
from fusion.surfacematch import Match
from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.math import Affine, Similarity

_AGAIN = "remove it and register again"
_DO = "give a registration.json, or JSON with model, scale, rotation_deg and translation_m"


def transform_of(content: Mapping[str, Any], where: str, *, do: str = _AGAIN) -> Affine:
    """Read the transform from lidar to SPC coordinates (metres) out of ``registration.json``.

    The `content` is that of the file `where`; errors name it and the remedy `do`.

    Raises
    ------
    InvalidValueError
        If a key is missing or is not a number, or the registration is refused.
    """
    if content.get("verdict") == "refused":
        raise InvalidValueError("is from a registration that was refused", where, do)
    try:
        translation = np.array(content["translation_m"], dtype=np.float64)
        if content["model"] == "affine":
            return Affine(content["matrix"], translation, SPC_FRAME, LIDAR_FRAME)
        turn = np.radians(np.array(content["rotation_deg"], dtype=np.float64))
        scale = float(content["scale"])
        return Similarity.from_rotation_vector(
            turn, translation, scale, SPC_FRAME, LIDAR_FRAME
        ).as_affine()
    except (KeyError, TypeError, ValueError, OverflowError, InvalidValueError) as error:
        raise InvalidValueError(f"has no usable transform ({error})", where, do) from error


@dataclass(frozen=True, eq=False)
class MapolaRegistration:
    """Registration of one mapola, in addition to the transform.

    Attributes
    ----------
    shift : (3,) ndarray
        Displacement by the errors of its scans, SPC coordinates, metres.
    residual : (3,) ndarray
        SPC surface minus registered mapola, metres; NaN if it does not match.
    covariance : (3, 3) ndarray
        Of its registered position, m².
    """

    shift: FloatArray
    residual: FloatArray
    covariance: FloatArray

    def grid(self, grid: MapletGrid, transform: Affine) -> MapletGrid:
        """Return the registered grid of a mapola.

        Parameters
        ----------
        grid : MapletGrid
            Of the mapola, lidar coordinates.
        transform : Affine
            Lidar → SPC.
        """
        moved = grid.moved(transform)
        return replace(moved, center=moved.center + self.shift)


def mapola_registrations(content: Mapping[str, Any], where: str) -> dict[str, MapolaRegistration]:
    """Read the registration of each mapola from the `content` of ``registration.json``.

    Errors name the file `where`.

    Raises
    ------
    InvalidValueError
        If a key is missing or has a value of the wrong type.
    """
    try:
        return {
            str(entry["name"]): MapolaRegistration(
                _vector(entry["scan_shift_m"]),
                _to_surface(entry),
                np.array(entry["position_covariance_m2"], dtype=np.float64).reshape(3, 3),
            )
            for entry in content["per_mapola"]
        }
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InvalidValueError(f"has no usable mapolas ({error})", where, _AGAIN) from error


@dataclass(frozen=True, eq=False)
class GivenRegistration:
    """The transform from lidar to SPC coordinates that a file gives.

    Attributes
    ----------
    known : KnownTransform
        From lidar to SPC coordinates.
    scans : mapping of str to (2, 3) or (3, 3) ndarray
        Addition to the adjustment of a scan: rows are its centre, displacement (metres) and
        rotation vector (radians).
    covariances : mapping of str to (center, covariance)
        Mapolas of the file: centre (3,) and covariance (3, 3), m², of the position.
    """

    known: KnownTransform
    scans: Mapping[str, FloatArray]
    covariances: Mapping[str, tuple[FloatArray, FloatArray]]

    def moved(self, grid: MapletGrid) -> MapletGrid:
        """Return the grid of a mapola moved by the transform alone."""
        return grid.moved(self.known.transform)

    def referred(self, match: Match, grid: MapletGrid) -> Match:
        """Convert a match of the moved grid to one of the mapola's own `grid`."""
        path = self.moved(grid).center - grid.center
        return replace(match, center=grid.center, displacement=match.displacement + path)


def given_registration(
    content: Mapping[str, Any], where: str, *, inverse: bool = False
) -> GivenRegistration:
    """Read a transform from ``registration.json``, or from JSON with the transform alone.

    Parameters
    ----------
    content : mapping
        `model`, `scale`, `rotation_deg` [3], `translation_m` [3] (of an affine map `matrix`);
        optional: `covariance`, and `per_scan` and `per_mapola` of a registration.
    where : str
        Name of the file, for errors.
    inverse : bool
        True if the file takes SPC to lidar coordinates. Its scans and mapolas are then ignored.

    Raises
    ------
    InvalidValueError
        If the content is not valid.
    """
    transform = transform_of(content, where, do=_DO)
    known = known_transform(content, transform, where, do=_DO)
    if inverse:
        back = known.inverse()
        named = Affine(back.transform.matrix, back.transform.translation, SPC_FRAME, LIDAR_FRAME)
        return GivenRegistration(replace(back, transform=named), {}, {})
    try:
        scans = {
            str(entry["scan"]): np.array(
                [entry["center_m"], entry["offset_m"], np.radians(entry["rotation_deg"])], float
            ).reshape(3, 3)
            for entry in content.get("per_scan") or ()
        }
        covariances = {
            str(entry["name"]): (
                np.array(entry["center_m"], float).reshape(3),
                np.array(entry["position_covariance_m2"], float).reshape(3, 3),
            )
            for entry in content.get("per_mapola") or ()
        }
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InvalidValueError(
            f"has no usable scans or mapolas ({error})",
            where,
            "remove them: the transform alone is enough",
        ) from error
    return GivenRegistration(known, scans, covariances)


def _to_surface(entry: Mapping[str, Any]) -> FloatArray:
    """SPC surface minus registered lidar (3,), metres; not the residual of a fit by images."""
    if "surface_residual_m" in entry:
        return _vector(entry["surface_residual_m"])
    return _vector(entry["residual_m"]) if entry["used"] else np.full(3, np.nan)


def _vector(values: Any) -> FloatArray:
    return np.array(values, dtype=np.float64).reshape(3)
