"""What is planted in a synthetic mission, and its file ``truth.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fusion.truth.blind.body import truth_body
from fusion.truth.blind.settings import BlindSettings
from fusion.truth.presets import MissionSettings
from fusion.truth.restoring import restored
from lidar.truth import ScanErrors
from spcola import atomic
from spcola.arrays import FloatArray
from spcola.errors import FormatError, SpcolaError, WorkspaceError
from spcola.grids import MapletGrid
from spcola.math import Similarity
from spcola.truth.body import TruthBody

TRUTH_FILE = "truth.json"
Value = TypeVar("Value")


@dataclass(frozen=True)
class PlacedCenter:
    """Frame of a maplet of the solution, and its true centre.

    Attributes
    ----------
    name : str
    center_m : tuple of 3 float
        In the frame of the solution.
    axes : tuple of 3 tuples of 3 float
        Ux, Uy, Uz, in the same frame.
    gsd : float
        Metres.
    half_size : int
    sigma_m : tuple of 3 float
        One standard deviation of the centre.
    true_center_m : tuple of 3 float
        The point of the true surface that it represents, body frame.
    """

    name: str
    center_m: tuple[float, ...]
    axes: tuple[tuple[float, ...], ...]
    gsd: float
    half_size: int
    sigma_m: tuple[float, ...]
    true_center_m: tuple[float, ...]

    @cached_property
    def grid(self) -> MapletGrid:
        """Frame and spacing, in the frame of the solution."""
        return MapletGrid(np.array(self.center_m), np.array(self.axes), self.gsd, self.half_size)

    @property
    def center_sigma(self) -> FloatArray:
        """One standard deviation of the centre (3,), metres."""
        return np.array(self.sigma_m)

    @property
    def true_center(self) -> FloatArray:
        """The point (3,) of the true surface that it represents, body frame, metres."""
        return np.array(self.true_center_m)


@dataclass(frozen=True)
class TrueState:
    """True state of an image, in the body frame.

    Attributes
    ----------
    position_m : tuple of 3 float
    axes : tuple of 3 tuples of 3 float
        Cx, Cy, Cz.
    """

    position_m: tuple[float, ...]
    axes: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, eq=False)
class Planted:
    """Planted values of a mission.

    Attributes
    ----------
    settings : MissionSettings
    scans : mapping of str to ScanErrors
        Errors of each scan, by its name.
    days : mapping of str to float
        Relative bias of the ranges of each day (``YYYY-MM-DD``).
    centers : mapping of str to PlacedCenter
        Solved and true centres of the maplets, by their names.
    images : mapping of str to TrueState
        True states of images, by their names.
    files : mapping of str to int
        Size in bytes of every file of the mission, by its path in the mission's folder.
    fingerprint : str
        Of the body: see :attr:`spcola.truth.body.TruthBody.fingerprint`.
    blind : mapping
        Of a blind mission: labels and errors of the kernels, rotations, overhangs, in JSON types.
    """

    settings: MissionSettings
    scans: Mapping[str, ScanErrors]
    days: Mapping[str, float]
    centers: Mapping[str, PlacedCenter] = field(default_factory=dict)
    images: Mapping[str, TrueState] = field(default_factory=dict)
    files: Mapping[str, int] = field(default_factory=dict)
    fingerprint: str = ""
    blind: Mapping[str, Any] = field(default_factory=dict)

    @property
    def similarity(self) -> Similarity:
        """Transform from lidar to SPC coordinates."""
        return self.settings.to_spc

    @property
    def epsilon(self) -> float:
        """SPC lengths have to be multiplied by 1 + ε."""
        return self.settings.epsilon

    @property
    def prime_meridian_deg(self) -> float:
        """Rotation about Z from lidar to SPC coordinates, degrees."""
        return self.settings.rotation_deg[2]

    def body(self) -> TruthBody:
        """Return the body, rebuilt from its settings.

        Raises
        ------
        FormatError
            If this version of the program makes another body from them.
        """
        body = truth_body(self.settings)
        if self.fingerprint and body.fingerprint != self.fingerprint:
            raise FormatError(
                "another version of this program made the mission, of another body",
                TRUTH_FILE,
                "make the mission again",
            )
        return body

    def is_of(self, settings: MissionSettings, fingerprint: str) -> bool:
        """Return whether it is the mission of these settings and this body."""
        return self.settings == settings and self.fingerprint == fingerprint

    def in_view(self) -> dict[str, Any]:
        """Return the main planted values, in JSON types."""
        return {
            "epsilon": self.epsilon,
            "scale": self.similarity.scale,
            "rotation_deg": list(self.settings.rotation_deg),
            "translation_m": list(self.settings.translation_m),
            "prime_meridian_deg": self.prime_meridian_deg,
            "day_scale_bias": dict(self.days),
        }

    def to_json(self) -> dict[str, Any]:
        """Return the content of ``truth.json``: planted values and settings."""
        return {
            **self.in_view(),
            "scans": {name: asdict(errors) for name, errors in self.scans.items()},
            "settings": asdict(self.settings),
            "centers": {name: asdict(center) for name, center in self.centers.items()},
            "images": {name: asdict(state) for name, state in self.images.items()},
            "files": dict(self.files),
            "fingerprint": self.fingerprint,
            **({"blind": dict(self.blind)} if self.blind else {}),
        }


def write_truth(path: str | Path, planted: Planted) -> None:
    """Write ``truth.json``.

    Raises
    ------
    WorkspaceError
        If the file cannot be written.
    """
    atomic.write_text(path, json.dumps(planted.to_json(), indent=1, ensure_ascii=False) + "\n")


def read_truth(path: str | Path) -> Planted:
    """Read ``truth.json`` (or the one in a folder).

    Raises
    ------
    WorkspaceError
        If it is not there.
    FormatError
        If :func:`write_truth` did not write it.
    """
    path = Path(path)
    path = path / TRUTH_FILE if path.is_dir() else path
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise WorkspaceError(
            f"cannot be read ({error.strerror})", path, "name the folder of a synthetic mission"
        ) from error
    except (ValueError, RecursionError) as error:
        raise FormatError("is not JSON text", path, "make the mission again") from error
    try:
        return Planted(
            _settings(content["settings"]),
            _all(ScanErrors, content["scans"]),
            dict(content["day_scale_bias"]),
            _all(PlacedCenter, content["centers"]),
            _all(TrueState, content["images"]),
            dict(content["files"]),
            str(content["fingerprint"]),
            dict(content.get("blind", {})),
        )
    except SpcolaError as error:
        raise FormatError(str(error), path, "make the mission again") from error
    except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise FormatError(
            f"an entry is missing or damaged: {error}", path, "make the mission again"
        ) from error


def _settings(values: Mapping[str, Any]) -> MissionSettings:
    """Return the settings of a mission; those of a blind one have a mesh."""
    return restored(BlindSettings if "solid" in values else MissionSettings, values)


def _all(kind: type[Value], entries: Mapping[str, Any]) -> dict[str, Value]:
    return {name: restored(kind, values, name) for name, values in entries.items()}
