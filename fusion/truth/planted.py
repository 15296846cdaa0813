"""What is planted in a synthetic mission, and the file that keeps it: ``truth.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lidar.truth import LidarSettings, ScanErrors
from spcola import atomic
from spcola.arrays import FloatArray
from spcola.errors import FormatError, SpcolaError, WorkspaceError
from spcola.similarity import Similarity
from spcola.truth.body import BodySettings, TruthBody
from spcola.truth.passes import PassSettings
from spcola.truth.relief import PowerLaw
from spcola.truth.solution import SolutionSettings
from spcola.truth.states import StateSettings

TRUTH_FILE = "truth.json"
LIDAR_FRAME, SPC_FRAME = "lidar", "spc"


@dataclass(frozen=True)
class MissionSettings:
    """A whole synthetic mission: its body, its errors, and what is planted.

    Parameters
    ----------
    seed : int
        Of everything but the body, which has its own.
    body, passes, lidar, solution, states
        Settings of the parts.
    epsilon : float
        All lengths of the SPC solution have to be multiplied by 1 + ε.
    rotation_deg : tuple of 3 float
        Rotation vector from lidar to SPC coordinates, degrees; its third component is the
        difference of the prime meridians.
    translation_m : tuple of 3 float
    day_scale_bias : tuple of float
        Relative bias of all ranges of a day, for each day in turn; empty for none.
    shape_q : int
        Q of the solution's ICQ shape.
    """

    seed: int = 1
    body: BodySettings = field(default_factory=BodySettings)
    passes: PassSettings = field(default_factory=PassSettings)
    lidar: LidarSettings = field(default_factory=LidarSettings)
    solution: SolutionSettings = field(default_factory=SolutionSettings)
    states: StateSettings = field(default_factory=StateSettings)
    epsilon: float = 2.5e-4
    rotation_deg: tuple[float, float, float] = (0.006, -0.008, 0.012)
    translation_m: tuple[float, float, float] = (0.07, -0.05, 0.04)
    day_scale_bias: tuple[float, ...] = ()
    shape_q: int = 64

    @classmethod
    def demo(cls, seed: int = 1) -> MissionSettings:
        """Return the mission of the demo: a body of 75 m, 20 scans, 64 maplets."""
        return cls(seed=seed, body=BodySettings(seed=seed))

    @classmethod
    def tiny(cls, seed: int = 1) -> MissionSettings:
        """Return a mission for tests: 40 m, 8 scans, 24 maplets; the same error levels."""
        return cls(
            seed=seed,
            body=BodySettings(seed=seed, radius=40.0),
            passes=PassSettings(count=8, days=2),
            lidar=LidarSettings(shots=8_100, width=1.5),
            solution=SolutionSettings(half_size=27, gsd=0.75, maplets=24),
            shape_q=24,
        )

    @property
    def to_spc(self) -> Similarity:
        """The planted similarity: ``V_spc = T + R V_lidar / (1 + ε)``."""
        return Similarity.from_rotation_vector(
            np.radians(self.rotation_deg),
            self.translation_m,
            1.0 / (1.0 + self.epsilon),
            target=SPC_FRAME,
            source=LIDAR_FRAME,
        )


@dataclass(frozen=True, eq=False)
class Planted:
    """What was planted.

    Attributes
    ----------
    settings : MissionSettings
    scans : mapping of str to ScanErrors
        Errors of each scan, by its name.
    days : mapping of str to float
        Relative bias of the ranges of each day (``YYYY-MM-DD``).
    """

    settings: MissionSettings
    scans: Mapping[str, ScanErrors]
    days: Mapping[str, float]

    @property
    def similarity(self) -> Similarity:
        """From lidar to SPC coordinates."""
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
        """Return the body, built anew from its settings."""
        return TruthBody(self.settings.body)

    def mean_scan_offset(self) -> FloatArray:
        """Mean error (3,) of the spacecraft positions over the scans, metres."""
        return np.mean([errors.offset_m for errors in self.scans.values()], axis=0)

    def to_json(self) -> dict[str, Any]:
        """Content of ``truth.json``: the planted values in view, the settings to rebuild them."""
        similarity = self.similarity
        return {
            "epsilon": self.epsilon,
            "scale": similarity.scale,
            "rotation_deg": list(self.settings.rotation_deg),
            "translation_m": list(self.settings.translation_m),
            "prime_meridian_deg": self.prime_meridian_deg,
            "day_scale_bias": dict(self.days),
            "scans": {name: asdict(errors) for name, errors in self.scans.items()},
            "settings": asdict(self.settings),
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
        If it is not what :func:`write_truth` writes.
    """
    path = Path(path)
    path = path / TRUTH_FILE if path.is_dir() else path
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise WorkspaceError(
            f"cannot be read ({error.strerror})", path, "name the folder of a synthetic mission"
        ) from error
    except ValueError as error:
        raise FormatError("is not JSON text", path, "make the mission again") from error
    try:
        settings = _settings(content["settings"])
        scans = {name: _scan_errors(values) for name, values in content["scans"].items()}
        return Planted(settings, scans, dict(content["day_scale_bias"]))
    except SpcolaError as error:
        raise FormatError(str(error), path, "make the mission again") from error
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise FormatError(
            f"lacks or garbles an entry: {error}", path, "make the mission again"
        ) from error


def _settings(values: dict[str, Any]) -> MissionSettings:
    body = dict(values["body"])
    for name in ("craters", "boulders"):
        body[name] = PowerLaw(**body[name])
    parts: dict[str, Any] = {
        "body": BodySettings(**body),
        "passes": PassSettings(**_tuples(values["passes"])),
        "lidar": LidarSettings(**values["lidar"]),
        "solution": SolutionSettings(**values["solution"]),
        "states": StateSettings(**_tuples(values["states"])),
    }
    rest = {name: value for name, value in values.items() if name not in parts}
    return MissionSettings(**parts, **_tuples(rest))


def _scan_errors(values: dict[str, Any]) -> ScanErrors:
    return ScanErrors(**_tuples(values))


def _tuples(values: dict[str, Any]) -> dict[str, Any]:
    """Give back to lists the type that they had before JSON."""
    return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
