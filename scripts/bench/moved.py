"""What one movement of the whole surface leaves of the errors of fused heights.

All heights of one mission share the error of its registration. Shares of the errors within sigma
are then one draw of that error, seen by every point: they scatter from seed to seed however right
the sigma is. Here the movement (shift, turn, scale) that fits the errors best is found with the
truth in hand and taken out, and the rest is compared with the sigma without its shared part.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fusion.registration.summary import Placement, placements_of
from fusion.stages.fuse import Scene
from fusion.truth.assessment.assess import light_on
from fusion.truth.assessment.gather import workspace_models
from fusion.truth.assessment.patches import patch_errors
from fusion.truth.assessment.regions import REGIONS, Ground
from fusion.truth.assessment.settings import AssessmentSettings
from fusion.truth.planted import read_truth
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.heights import slopes_of
from spcola.maplet import Maplet

FUSED = "fused maplets"
# Errors beyond that many of their deviations do not tell of a movement.
FAR = 3.0
ROUNDS = 5


class Errors:
    """Errors of fused heights (N,), their sigmas, regions, and what a movement does to them."""

    def __init__(self, workspace: Path, mission: Path) -> None:
        planted = read_truth(mission)
        ground = Ground(planted.body(), light_on(planted), AssessmentSettings())
        opened = Workspace.open(workspace)
        path = opened.registration_path
        placements = placements_of(opened.read_json(path.name), str(path))
        scene = Scene.of(opened, light="none")
        (model,) = (m for m in workspace_models(opened) if m.name == FUSED)
        parts: list[list[FloatArray]] = []
        for key in model.keys(AssessmentSettings().patches):
            patch = patch_errors(model.patch(key), ground, planted.similarity)
            near = scene.near(key, patch.maplet.grid)
            known = np.isfinite(patch.error)
            movement = movements(patch.maplet)[known]
            shared = shared_variance(movement, placements[near[0]] if near else None)
            parts.append(
                [
                    patch.error[known],
                    np.square(patch.maplet.sigma[known]),
                    shared,
                    patch.points.regions,
                    movement,
                ]
            )
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        self.error, self.variance, self.shared, self.regions, self.movement = columns

    def best_movement(self) -> FloatArray:
        """Return shift (m), turn (rad) and scale (7,) that leave least of the errors."""
        found = np.zeros(self.movement.shape[1])
        own = np.sqrt(self.variance - self.shared)
        for _ in range(ROUNDS):
            left = (self.error - self.movement @ found) / own
            near = np.abs(left) < FAR * np.median(np.abs(left)) / 0.6745
            rows = self.movement[near] / own[near, None]
            found = np.linalg.lstsq(rows.T @ rows, rows.T @ (self.error / own)[near], rcond=None)[0]
        return found

    def lines(self) -> Iterator[str]:
        """Yield the table."""
        moved = self.movement @ self.best_movement()
        left, own = self.error - moved, np.sqrt(self.variance - self.shared)
        stated = np.sqrt(np.mean(self.shared))
        yield (
            f"one movement    moves heights by {np.sqrt(np.mean(moved**2)):.4f} m (rms), "
            f"stated of what they share {stated:.4f} m; taken out:"
        )
        cells = []
        for region in REGIONS[1:4]:
            inside = (self.regions >> REGIONS.index(region)) & 1 > 0
            if not inside.any():
                continue
            pulls = np.abs(left[inside]) / own[inside]
            shares = " ".join(f"{np.mean(pulls < k):.3f}" for k in (1, 2))
            rms = np.sqrt(np.mean(left[inside] ** 2))
            cells.append(f"{region} {rms:.4f} m, within 1, 2 σ {shares}")
        yield "                " + "; ".join(cells)


def movements(maplet: Maplet) -> FloatArray:
    """Return what shifts, turns and a scale of the surface do to its heights (R, C, 7).

    A surface displaced by D is met at a height that is off by D·(Uz − ∂h/∂x Ux − ∂h/∂y Uy).
    """
    slope_x, slope_y = slopes_of(maplet.height, maplet.grid.gsd)
    lean = np.nan_to_num(np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1))
    normal = lean @ maplet.grid.axes
    place = maplet.grid.points(np.nan_to_num(maplet.height))
    scaled = np.sum(normal * place, axis=-1, keepdims=True)
    return np.concatenate([normal, np.cross(place, normal), scaled], axis=-1)


def shared_variance(movement: FloatArray, placement: Placement | None) -> FloatArray:
    """Variance (N,), m², of heights by the error of where their mapola is registered."""
    if placement is None:
        return np.zeros(len(movement))
    normal = movement[:, :3]
    variance: FloatArray = np.einsum("ni,ij,nj->n", normal, placement.covariance, normal)
    return variance
