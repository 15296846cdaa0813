"""Accuracy of the registration of a mission, and what limits it, by comparison with the truth.

For each mission with its workspace (mapolas made), errors over stated sigmas of

- `as it is`: the transform as the program registers the mission;
- `true scans`: mapolas with the heights of the true body, so that scans have no errors;
- `true centres`: the same, without each maplet's planted error of its centre in its match:
  the limit of the match of surfaces alone.

At the end the rms errors over the missions, the rms of the stated sigmas and the bar.

    python scripts/bench/limits.py MISSION=WORKSPACE [MISSION=WORKSPACE ...] [--every 1]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from limit_tables import Part, Row, print_cases

from fusion.registration.fit import (
    FitOptions,
    LandmarkErrors,
    MatchedMapolas,
    Registration,
    ScanErrorPatterns,
    fit_mapolas,
    share_matrix,
)
from fusion.runtime import ThreadExecutor, usable_cores
from fusion.scene import Reference, surface_reference
from fusion.surfacematch import Match, Surface, match_surfaces
from fusion.surfacematch.resolution import estimate_blur, estimate_spectrum
from fusion.truth import read_truth
from fusion.truth.planted import Planted
from fusion.workspace import Workspace
from lidar.gridding import Mapola
from spcola.control.bundle_adjustment import Network, NetworkOptions, solve_network

PARTS = {
    "translation": Part(slice(0, 3), "mm", 2.0),
    "rotation": Part(slice(3, 6), "1e-4 deg", 1.0),
    "scale": Part(slice(6, 7), "1e-6", 2.0),
}
SAMPLE = 24


class Case:
    """One mission, its mapolas, and its maplets' errors."""

    def __init__(self, mission: Path, workspace: Path, every: int) -> None:
        self.planted: Planted = read_truth(mission)
        self.workspace = Workspace.open(workspace)
        self.names = self.workspace.mapola_names()[::every]
        self.reference: Reference = surface_reference(self.workspace, "maplets")
        self.executor = ThreadExecutor(usable_cores())
        known = [self.workspace.landmark(name) for name in self.workspace.landmark_names()]
        self.network: Network = solve_network(
            [one.name for one in known],
            np.array([one.grid.center for one in known]),
            np.array([one.sigma for one in known]),
            self.workspace.images(),
            options=NetworkOptions(),
        )

    def mapped(self, function: Callable[[str], object], names: Sequence[str]) -> list[object]:
        return list(self.executor.stream(function, names))

    def heights(self) -> dict[str, Surface]:
        """Return the heights of the mapolas as they are."""
        return {name: surface_of(self.workspace.mapola(name)) for name in self.names}

    def true_heights(self) -> dict[str, Surface]:
        """Return the same points with heights of the true body, and noise of half their sigma."""
        body, found = self.planted.body(), {}
        for number, name in enumerate(self.names):
            mapola = self.workspace.mapola(name)
            noise = np.random.default_rng(number).normal(size=mapola.height.shape)
            truth = body.heights(mapola.grid) + 0.5 * np.nan_to_num(mapola.sigma) * noise
            known = np.isfinite(mapola.height)
            found[name] = Surface(np.where(known, truth, np.nan), mapola.sigma)
        return found

    def matches(self, heights: dict[str, Surface]) -> list[Match]:
        """Match all mapolas as the program does."""
        sample = self.names[:: -(-len(self.names) // SAMPLE)]

        def match(name: str, blur: float = 0.0, spectrum: object = None) -> Match:
            grid = self.workspace.mapola(name).grid
            spc = self.reference(name, grid)
            return match_surfaces(
                name, grid, heights[name], spc, blur_cells=blur, spectrum=spectrum
            )

        def blur_of(found: Match) -> float:
            grid = self.workspace.mapola(found.name).grid
            spc = self.reference(found.name, grid).height
            return estimate_blur(spc - found.residual, spc)

        first = [match(name) for name in sample]
        blur = float(np.nanmedian([blur_of(one) for one in first if one.usable]))
        again = [match(name, blur) for name in sample]
        spectrum = estimate_spectrum(one.residual for one in again if one.usable)
        start = time.perf_counter()
        found = self.mapped(lambda name: match(name, blur, spectrum), self.names)
        took = time.perf_counter() - start
        print(f"    matched {len(found) / took:.0f} mapolas/s (reading and projecting in it)")
        return found

    def mapolas(self, matches: list[Match], scans: bool) -> MatchedMapolas:
        """Return matches with the scan errors left by the adjustment, or with none."""
        shares = [self.workspace.mapola(match.name).scan_share for match in matches]
        centers = np.array([match.center for match in matches])
        adjustment = self.workspace.adjustment()
        if scans and adjustment is not None:
            matrix = share_matrix(shares, adjustment.names)
            effects = ScanErrorPatterns.of_adjustment(adjustment, matrix, centers)
        else:
            names = sorted({name for share in shares for name in share})
            matrix = share_matrix(shares, names)
            effects = ScanErrorPatterns.independent(names, 0.0)
        return MatchedMapolas.of(matches, effects, matrix)

    def landmarks(self) -> LandmarkErrors:
        return LandmarkErrors.of_mapolas(self.network, self.names, 0.05)

    def without_center_errors(self, matches: list[Match]) -> list[Match]:
        """Return the matches minus the planted errors of the maplets' centres."""
        similarity, centers = self.planted.similarity, self.planted.centers
        moved = []
        for match in matches:
            true = similarity.apply(np.array(centers[match.name].true_center_m))
            error = self.workspace.maplet(match.name).grid.center - true
            moved.append(replace(match, displacement=match.displacement - error))
        return moved

    def row(self, registration: Registration) -> Row:
        """Return errors and sigmas of a registration."""
        planted = self.planted.similarity
        scale, scale_sigma, rotation, rotation_sigma = registration.similarity_numbers()
        sigma = np.sqrt(np.diag(registration.covariance))[:3]
        shift = registration.transform.translation - planted.translation
        error = [
            *(1e3 * shift),
            *(1e4 * np.degrees(rotation - planted.rotation_vector)),
            1e6 * (scale - planted.scale),
        ]
        stated = [*(1e3 * sigma), *(1e4 * np.degrees(rotation_sigma)), 1e6 * scale_sigma]
        return Row(np.array(error), np.array(stated))

    def rows(self) -> dict[str, Row]:
        """Return all three registrations."""
        found = {}
        whole = replace(
            self.mapolas(self.matches(self.heights()), True), landmarks=self.landmarks()
        )
        found["as it is"] = self.row(fit_mapolas(whole, options=FitOptions()))
        matches = self.matches(self.true_heights())
        true = replace(self.mapolas(matches, False), landmarks=self.landmarks())
        found["true scans"] = self.row(fit_mapolas(true, options=FitOptions()))
        bare = self.mapolas(self.without_center_errors(matches), False)
        found["true centres"] = self.row(fit_mapolas(bare, options=FitOptions(center_sigma_m=1e-3)))
        return found


def surface_of(mapola: Mapola) -> Surface:
    return Surface(mapola.height, mapola.sigma)


def main() -> None:
    parser = argparse.ArgumentParser(description="Accuracy and limits of a registration.")
    parser.add_argument("--every", type=int, default=1, help="use each so many-th mapola")
    print_cases(
        PARTS,
        lambda mission, workspace, options: Case(mission, workspace, options.every).rows().items(),
        parser,
    )


if __name__ == "__main__":
    main()
