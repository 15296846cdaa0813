#!/usr/bin/env python3
"""The scale, and the registration: planted against recovered over seeds.

A mission of each seed is made without its images, its scans are imported, and the scale is found
(with `--method shots` by single shots against the shape); with `--registration` the scans are
adjusted and gridded before, and registered. Printed for each parameter: mean and standard deviation
of the pulls (recovered − planted) / sigma, their root mean square about zero with the interval of
95 % and the limit, 1; the rms error and the rms of the stated sigmas. `mini` takes half a minute to
a minute a seed. `--lines FILE` keeps a line for each mission and resumes from there.

The missions plant no range bias, but the sigma of the scale includes the prior of one. With
`--drawn-bias` each has a bias drawn from that prior: pulls should then scatter by 1.
With `--by images` or `both` the missions have images, and are registered by them (three minutes).

    python scripts/bench/scale.py [--seeds 20] [--preset tiny|mini] [--method pairs|shots]
                               [--registration] [--by topography|images|both] [--drawn-bias]
"""

from __future__ import annotations

import tempfile
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from pulls import PRESETS, missions, parser_of

from fusion.pipeline import Pipeline
from fusion.report.planted import RecoveredParameter
from fusion.runtime import Progress, ThreadExecutor, usable_cores
from fusion.scaling.fit import ScaleOptions
from fusion.stages import import_scans, load_stages
from fusion.truth import make_mission
from fusion.truth.generation import LIDAR_FOLDER, SPC_FOLDER
from fusion.truth.presets import MissionSettings
from fusion.truth.recovery import compare
from fusion.workspace import new_workspace


@dataclass(frozen=True)
class Kind:
    """Options for each seed."""

    preset: str
    method: str
    registration: bool
    drawn_bias: bool
    by: str = "topography"

    def mission(self, seed: int) -> MissionSettings:
        """Return the mission of a seed, with images if they are used."""
        settings = PRESETS[self.preset](seed).with_images(self.by != "topography")
        if not self.drawn_bias:
            return settings
        prior = ScaleOptions().range_bias_prior_m
        # A separate stream: other draws of the seed are unchanged.
        bias = prior * float(np.random.default_rng([seed, 1]).normal())
        return replace(settings, lidar=replace(settings.lidar, range_bias=bias))


def recovered(kind: Kind, seed: int) -> list[RecoveredParameter]:
    """Make the mission of a seed, and return recovered and planted values."""
    settings = kind.mission(seed)
    executor, progress = ThreadExecutor(usable_cores()), Progress.fitting(silent=True)
    with tempfile.TemporaryDirectory() as folder:
        mission = Path(folder) / "mission"
        planted = make_mission(mission, settings=settings, executor=executor, progress=progress)
        workspace = new_workspace(Path(folder) / "ws", body="Truth", spc=mission / SPC_FOLDER)
        chosen = workspace.settings().with_table("scale", method=kind.method)
        chosen = chosen.with_table("register", by=kind.by)
        files = sorted((mission / LIDAR_FOLDER).iterdir())
        import_scans(workspace, files, settings=chosen, executor=executor)
        pipeline = Pipeline(workspace, chosen, load_stages(), executor, progress)
        for stage in ("mapolas", "register", "scale") if kind.registration else ("scale",):
            pipeline.run_stage(stage)
        found = workspace.read_json(workspace.scale_path.name)
        fitted = workspace.read_json(workspace.registration_path.name) if kind.registration else {}
    rows = compare(planted, fitted, found)
    return [row for row in rows if kind.registration or not row.name.startswith("registration")]


def main() -> None:
    parser = parser_of("Planted against recovered scale over seeds.")
    parser.add_argument("--method", choices=("pairs", "shots"), default="pairs")
    parser.add_argument("--registration", action="store_true", help="register too")
    parser.add_argument("--drawn-bias", action="store_true", help="plant range biases")
    ways = ("topography", "images", "both")
    parser.add_argument("--by", choices=ways, help="register by that")
    options = parser.parse_args()
    registration = options.registration or options.by is not None
    kind = Kind(
        options.preset, options.method, registration, options.drawn_bias, options.by or ways[0]
    )
    missions(asdict(kind), partial(recovered, kind), options)


if __name__ == "__main__":
    main()
