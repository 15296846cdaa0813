"""Accuracy of the scale of a mission, and what limits it, by comparison with the truth.

For each mission with its workspace (scans imported), errors over stated sigmas of ε, the centre's
offset, the pole and the prime meridian, with more and more known:

- `as it is`: as the program estimates them from paired bigmaps;
- `+ range bias`: the constant error of ranges is known;
- `+ states`: returns are geolocated by the true states of the images, too;
- `+ ground`: the SPC bigmaps have the heights of the true body, too: maplets have no errors;
- `+ pointing, days`: the pointing of each scan and the range errors of each day are known, too: the
  limit of returns and their matches.

At the end the rms errors over the missions, the rms of the stated sigmas and the bar.
Pairs are made twice, which takes minutes for a mission of the size of Bennu.

    python scripts/bench/scale_limits.py MISSION=WORKSPACE [MISSION=WORKSPACE ...]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from limit_tables import Part, Row, print_cases

from fusion.pipeline import StageContext
from fusion.runtime import Progress, ThreadExecutor, usable_cores
from fusion.scaling.fit import ScaleEstimate, ScaleOptions, estimate_scale
from fusion.scaling.fit.observation import ScaleObservations
from fusion.scaling.pairs import Pair, pair_observations, rematch
from fusion.stages.scale.pairing import Pairing, pair_images
from fusion.stages.scale.stage import STAGE
from fusion.truth import read_truth
from fusion.truth.planted import Planted
from fusion.workspace import Workspace
from lidar.truth import scan_name
from lidar.truth.shots import raster_shots
from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.shape import RayCaster
from spcola.truth.body import stream
from spcola.truth.campaign import plan_passes

PARTS = {
    "epsilon": Part(slice(0, 1), "1e-6", 5.0),
    "centre": Part(slice(1, 4), "cm", 1.0),
    "pole": Part(slice(4, 6), "1e-3 deg", 1.0),
    "meridian": Part(slice(6, 7), "1e-3 deg", 1.0),
}
TO_UNITS = np.array([1e6, *[1e2] * 3, *[1e3 * np.degrees(1.0)] * 3])
# Prior of a known error: negligible against the others, metres.
NONE = 1e-4


@dataclass(frozen=True)
class TrueStates(Workspace):
    """A workspace whose images have their true states, in the frame of the solution."""

    planted: Planted = field(kw_only=True)

    def image(self, name: str) -> SpcImage:
        """Read the image `name`, with its true state."""
        solved, true = super().image(name), self.planted.images[name]
        position = self.planted.similarity.apply(np.array(true.position_m))
        axes = self.planted.similarity.turn(np.array(true.axes))
        return replace(solved, scobj=-position, axes=axes)


def row_of(estimate: ScaleEstimate, planted: Planted) -> Row:
    """Compare an estimate with what was planted."""
    true = [planted.epsilon, 0.0, 0.0, 0.0, *np.radians(planted.settings.rotation_deg)]
    error = estimate.fit.estimate[:7] - np.array(true)
    return Row(error * TO_UNITS, estimate.fit.sigma[:7] * TO_UNITS)


class Case:
    """One mission and its workspace."""

    def __init__(self, mission: Path, workspace: Path) -> None:
        self.planted = read_truth(mission)
        self.workspace = Workspace.open(workspace)
        self.true_states = TrueStates(self.workspace.root, planted=self.planted)
        self.executor = ThreadExecutor(usable_cores())
        self.body = self.planted.body()

    def pairing(self, workspace: Workspace) -> Pairing:
        """Pair all images as the program does."""
        start = time.perf_counter()
        shape = workspace.shape()
        silent, scratch = Progress.fitting(silent=True), workspace.root / ".scratch"
        settings = workspace.settings()
        context = StageContext(
            workspace, settings, STAGE.tables, self.executor, silent, {}, "", scratch
        )
        radius = settings.body.mean_radius_m or shape.mean_radius
        made = pair_images(context, RayCaster(shape), radius)
        print(f"    {len(made.pairs)} pairs in {time.perf_counter() - start:.0f} s", flush=True)
        return made

    def on_true_ground(self, made: Pairing) -> list[Pair]:
        """Return the pairs with the heights of the true body instead of those of maplets."""
        back, shrunk = self.planted.similarity.inverse(), self.planted.similarity.scale

        def true(pair: Pair) -> Pair:
            # The same nodes on the body: it is larger than the solution by its scale.
            grid = replace(pair.spc.grid.moved(back), gsd=pair.spc.grid.gsd / shrunk)
            height = np.where(pair.spc.valid, self.body.heights(grid) * shrunk, np.nan)
            sigma = np.where(pair.spc.valid, 1e-3, np.nan)
            return replace(pair, spc=replace(pair.spc, height=height, sigma=sigma))

        pairs = [true(pair) for pair in made.pairs]
        first = self.executor.stream(
            lambda pair: rematch(pair, made.options, blur_cells=0.0), pairs
        )
        blur = float(
            np.nanmedian([pair.relative_blur() for pair in first if isinstance(pair, Pair)])
        )
        again = self.executor.stream(
            lambda pair: rematch(pair, made.options, blur_cells=blur), pairs
        )
        return [pair for pair in again if isinstance(pair, Pair)]

    def without_bias(self, observations: ScaleObservations) -> ScaleObservations:
        """Return the observations without the planted range bias."""
        return less(observations, self.planted.settings.lidar.range_bias * observations.beam)

    def without_scan_errors(self, observations: ScaleObservations) -> ScaleObservations:
        """Return the observations without planted pointing of scans and range errors of days."""
        return less(observations, self.aside(observations) + self.longer(observations))

    def aside(self, observations: ScaleObservations) -> FloatArray:
        """Return the displacement (N, 3) of observations by planted pointing of scans, metres."""
        settings, seed = self.planted.settings, self.planted.settings.seed
        sides = {}
        for at in plan_passes(settings.passes, stream(seed, "passes")):
            shots = next(raster_shots(self.body, at, settings.lidar, stream(seed, "sides"), 1))
            sides[scan_name(at)] = np.stack([shots.along, shots.across])
        return np.array(
            [
                np.array(self.planted.scans[name].pointing_m)
                @ self.planted.similarity.turn(sides[name])
                for name in observations.scan
            ]
        )

    def longer(self, observations: ScaleObservations) -> FloatArray:
        """Return the displacement (N, 3) of observations by range errors of days, metres."""
        shares = np.array([self.planted.scans[name].range_scale for name in observations.scan])
        longer: FloatArray = (shares * observations.range)[:, None] * observations.beam
        return longer

    def rows(self) -> Iterator[tuple[str, Row]]:
        """Yield errors and sigmas, with more and more known."""
        yield from self._as_it_is(self.pairing(self.workspace))
        made = self.pairing(self.true_states)
        known = replace(ScaleOptions(), range_bias_prior_m=NONE, state_sigma_m=NONE)
        yield "+ states", self._row(observed(made, made.pairs), known)
        ground = pair_observations(self.on_true_ground(made), "spc")
        yield "+ ground", self._row(ground, known)
        all_known = replace(known, scan_sigma_m=NONE, day_sigma_m=NONE)
        yield "+ pointing, days", self._row(self.without_scan_errors(ground), all_known)

    def _as_it_is(self, made: Pairing) -> Iterator[tuple[str, Row]]:
        observations = observed(made, made.pairs)
        yield "as it is", row_of(estimate_scale(observations), self.planted)
        known = replace(ScaleOptions(), range_bias_prior_m=NONE)
        yield "+ range bias", self._row(observations, known)

    def _row(self, observations: ScaleObservations, options: ScaleOptions) -> Row:
        """Return errors and sigmas for a known range bias, with the priors of the options."""
        estimate = estimate_scale(self.without_bias(observations), options=options)
        return row_of(estimate, self.planted)


def observed(made: Pairing, pairs: list[Pair]) -> ScaleObservations:
    """Return the observations of pairs as the stage does."""
    per_axis = np.sqrt(np.mean(made.center_sigma**2, axis=1))
    return pair_observations(pairs, "spc", center_sigma=per_axis)


def less(observations: ScaleObservations, displaced: FloatArray) -> ScaleObservations:
    """Return the observations minus displacements (N, 3) of the lidar's surfaces, metres."""
    return replace(observations, value=observations.value - observations.as_observed(displaced))


def main() -> None:
    print_cases(
        PARTS,
        lambda mission, workspace, _: Case(mission, workspace).rows(),
        argparse.ArgumentParser(description="Accuracy and limits of a scale."),
    )


if __name__ == "__main__":
    main()
