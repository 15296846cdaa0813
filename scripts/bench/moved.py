"""Errors of fused heights that are left after the best movement of the surface.

All heights of one mission share the error of its registration, and all heights of a place those of
its scans. Shares of the errors within sigma then come from a few draws of those errors, each common
to many points: they scatter from seed to seed even if sigma is correct. Here the movement (shift,
rotation, scale) that best fits the errors against the truth is removed, and the rest is compared
with the sigma without its shared part; then the same with a displacement of each maplet. Only
points with lidar, where heights share such errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from limit_tables import rms

from fusion.fusing.maplets import FusedMaplet, Source
from fusion.registration.results import MapolaRegistration, mapola_registrations
from fusion.scene import Scene
from fusion.truth import read_truth
from fusion.truth.assessment import AssessmentSettings
from fusion.truth.assessment.assessment import light_on
from fusion.truth.assessment.patches import patch_errors
from fusion.truth.assessment.regions import REGIONS, Ground
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.heights.slopes import slopes_of

# Errors beyond so many robust standard deviations are not used to fit a movement.
FAR = 3.0
ROUNDS = 5
# Most maplets used.
MOST = 200
# Fewest points of a maplet.
ENOUGH = 100


class Errors:
    """Errors of fused heights (N,), their variances, regions, maplets, and movements (N, 7)."""

    def __init__(self, workspace: Path, mission: Path) -> None:
        planted = read_truth(mission)
        ground = Ground(body := planted.body(), light_on(planted, body), AssessmentSettings())
        opened = Workspace.open(workspace)
        path = opened.registration_path
        placements = mapola_registrations(opened.read_json(path.name), str(path))
        scene = Scene.of(opened, light="none")
        parts: list[list[FloatArray]] = []
        names = opened.fused_names()
        for number, name in enumerate(names[:: -(-len(names) // MOST)]):
            maplet = opened.fused(name)
            near = scene.near(name, maplet.grid)
            patch = patch_errors(maplet, ground, planted.similarity)
            known = np.isfinite(patch.error)
            measured = np.isin(maplet.source, (Source.LIDAR, Source.BOTH))
            if not near or np.count_nonzero(known & measured) < ENOUGH:
                continue
            movement = movements(maplet)[known & measured]
            parts.append(
                [
                    patch.error[known & measured],
                    np.square(maplet.sigma[known & measured]),
                    shared_variance(movement, placements[near[0]]),
                    patch.points.regions[measured[known]],
                    np.full(len(movement), number),
                    movement,
                ]
            )
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        self.error, self.variance, self.shared, self.regions, self.maplet, self.movement = columns

    @property
    def own(self) -> FloatArray:
        """Sigma (N,), metres, of errors that heights do not share."""
        sigma: FloatArray = np.sqrt(self.variance - self.shared)
        return sigma

    def of_all(self) -> FloatArray:
        """Return the effect on the heights (N,) of the best shift, rotation and scale of all."""
        return self.movement @ fitted_movement(self.movement, self.error, self.own)

    def of_each(self) -> FloatArray:
        """Return the effect on the heights (N,) of the best displacement of each maplet."""
        moved = np.zeros(len(self.error))
        for number in np.unique(self.maplet):
            its = self.maplet == number
            rows = self.movement[its, :3]
            moved[its] = rows @ fitted_movement(rows, self.error[its], self.own[its])
        return moved

    def lines(self) -> Iterator[str]:
        """Yield the table."""
        yield f"shared          stated {rms(np.sqrt(self.shared)):.4f} m of the heights on lidar"
        yield from self._left("one movement", self.of_all())
        yield from self._left("each maplet's", self.of_each())

    def _left(self, title: str, moved: FloatArray) -> Iterator[str]:
        cells = []
        for region in REGIONS[1:4]:
            inside = (self.regions >> REGIONS.index(region)) & 1 > 0
            if inside.any():
                left = (self.error - moved)[inside]
                pulls = np.abs(left) / self.own[inside]
                shares = " ".join(f"{np.mean(pulls < k):.3f}" for k in (1, 2))
                cells.append(f"{region} {rms(left):.4f} m, {shares}")
        yield f"{title:16}{rms(moved):.4f} m (rms); without it, within 1, 2 σ: {'; '.join(cells)}"


def fitted_movement(rows: FloatArray, error: FloatArray, own: FloatArray) -> FloatArray:
    """Return the parameters of `rows` (N, P) that minimise the errors (N,)."""
    found = np.zeros(rows.shape[1])
    for _ in range(ROUNDS):
        left = np.abs(error - rows @ found) / own
        near = left < FAR * np.median(left) / 0.6745
        weighed = rows[near] / own[near, None]
        normal, right = weighed.T @ weighed, weighed.T @ (error / own)[near]
        found = np.linalg.lstsq(normal, right, rcond=None)[0]
    return found


def movements(maplet: FusedMaplet) -> FloatArray:
    """Return the partials (R, C, 7) of heights by shift, rotation and scale of the surface.

    Displacing a surface by D changes its height by D·(Uz − ∂h/∂x Ux − ∂h/∂y Uy).
    """
    slope_x, slope_y = slopes_of(maplet.height, maplet.grid.gsd)
    partials = np.nan_to_num(np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1))
    normal = partials @ maplet.grid.axes
    place = maplet.grid.points(np.nan_to_num(maplet.height))
    scaled = np.sum(normal * place, axis=-1, keepdims=True)
    return np.concatenate([normal, np.cross(place, normal), scaled], axis=-1)


def shared_variance(movement: FloatArray, placement: MapolaRegistration) -> FloatArray:
    """Return the variance (N,), m², of heights by the registration error of their mapola."""
    normal = movement[:, :3]
    variance: FloatArray = np.einsum("ni,ij,nj->n", normal, placement.covariance, normal)
    return variance
