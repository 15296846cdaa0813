"""Score of one model against the truth: its numbers, and the data of its figures."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fusion.runtime import Executor, Progress
from fusion.truth.assessment.distances import Distances, measure_distances
from fusion.truth.assessment.model import Model, squares
from fusion.truth.assessment.patches import PatchErrors, patch_errors
from fusion.truth.assessment.regions import Ground, PointErrors, RegionScore, score_regions
from fusion.truth.assessment.resolution import Spectra, Transfer
from fusion.truth.assessment.settings import AssessmentSettings
from spcola.arrays import FloatArray
from spcola.grids import Maplet
from spcola.math import Similarity


@dataclass(frozen=True, eq=False)
class ModelScore:
    """Assessment of one model.

    Attributes
    ----------
    name : str
    frame : str
        "spc": heights are compared after the planted similarity; "body": without it.
    gsd : float
        The finest ground sample distance of its maplets, or the spacing of its vertices, metres.
    patches, patches_there : int
        Maplets whose heights were compared, and how many there are.
    distances : Distances
    regions : tuple of RegionScore
    transfer : Transfer
    errors : PointErrors
        Errors of all points compared, for histograms and maps.
    examples : tuple of PatchErrors
        The patches of smallest, median and largest rms.
    """

    name: str
    frame: str
    gsd: float
    patches: int
    patches_there: int
    distances: Distances
    regions: tuple[RegionScore, ...]
    transfer: Transfer
    errors: PointErrors
    examples: tuple[PatchErrors, ...]


def score_model(
    model: Model,
    ground: Ground,
    to_spc: Similarity,
    executor: Executor,
    progress: Progress,
) -> ModelScore | None:
    """Compare one model with the truth; None if it has no heights.

    Parameters
    ----------
    model : Model
    ground : Ground
        The truth in the body's frame, its light, and the settings.
    to_spc : Similarity
        The planted similarity.
    executor : Executor
    progress : Progress
    """
    settings, mesh = ground.settings, model.mesh
    sums = _compared(model, ground, to_spc, executor, progress)
    if not sums.points:
        return None
    errors = sums.errors()
    vertices = np.concatenate(sums.vertices) if mesh is None else _some(mesh.vertices, settings)
    with progress.task(f"3D rms of {model.name}", 1) as task:
        distances = measure_distances(vertices, ground.truth, settings, mesh)
        task.advance()
    return ModelScore(
        model.name,
        model.frame,
        sums.finest,
        len(sums.points),
        len(model.keys(1 << 40)),
        distances,
        tuple(score_regions(errors)),
        sums.transfer(),
        errors,
        tuple(sums.examples()),
    )


def _compared(
    model: Model, ground: Ground, to_spc: Similarity, executor: Executor, progress: Progress
) -> _Sums:
    """Compare patch by patch, and choose vertices for the 3D rms."""
    settings = ground.settings
    same = Similarity(target=to_spc.source, source=to_spc.source)
    to_model = to_spc if model.frame == "spc" else same
    keys = model.keys(settings.patches)
    each = max(1, settings.patches // max(len(keys), 1))
    quota = -(-settings.vertices // max(len(keys), 1))

    def one(key: str) -> _Part:
        parts = squares(model.patch(key), settings.patch_half_size, each)
        found = [patch_errors(part, ground, to_model) for part in parts]
        chosen = [_vertices(part, -(-quota // len(parts)), settings.seed) for part in parts]
        return _Part([patch for patch in found if len(patch.points.height)], chosen)

    sums = _Sums()
    with progress.task(f"compare {model.name}", len(keys)) as task:
        for part in executor.stream(one, keys):
            sums.add(part)
            task.advance()
    return sums


@dataclass(frozen=True, eq=False)
class _Part:
    """Errors and vertices of one patch of a model."""

    patches: Sequence[PatchErrors]
    vertices: Sequence[FloatArray]


class _Sums:
    """Results of the patches compared so far."""

    def __init__(self) -> None:
        self.points: list[PointErrors] = []
        self.vertices: list[FloatArray] = []
        self.finest = float("inf")
        self._spectra: dict[tuple[float, int], Spectra] = {}
        self._ranked: list[PatchErrors] = []

    def add(self, part: _Part) -> None:
        """Add the results of one patch."""
        self.vertices += part.vertices
        for patch in part.patches:
            grid = patch.maplet.grid
            self.points.append(patch.points)
            self.finest = min(self.finest, grid.gsd)
            key = (round(grid.gsd, 6), grid.size)
            spectra = self._spectra.setdefault(key, Spectra(grid.size, grid.gsd))
            spectra.add(patch.maplet.height, patch.truth)
            self._ranked.append(patch)

    def errors(self) -> PointErrors:
        """Return the errors of all points."""
        parts = zip(*(_layers(points) for points in self.points), strict=True)
        return PointErrors(*(np.concatenate(layer) for layer in parts))

    def transfer(self) -> Transfer:
        """Return the transfer at the GSD and size with the most windows."""
        return max(self._spectra.values(), key=lambda s: s.windows).transfer()

    def examples(self) -> list[PatchErrors]:
        """Return the patches of smallest, median and largest rms of those nearly complete."""
        whole = [p for p in self._ranked if len(p.points.height) > 0.5 * p.maplet.height.size]
        ranked = sorted(whole or self._ranked, key=lambda patch: patch.rms)
        places = sorted({0, len(ranked) // 2, len(ranked) - 1})
        return [ranked[place] for place in places]


def _layers(points: PointErrors) -> tuple[FloatArray, ...]:
    return points.height, points.slope, points.sigma, points.direction, points.regions


def _vertices(maplet: Maplet, most: int, seed: int) -> FloatArray:
    """Return at most `most` of the maplet's points (N, 3), chosen by its name and `seed`."""
    points = maplet.points()[maplet.valid]
    if len(points) <= most:
        return points
    generator = np.random.default_rng([seed, zlib.crc32(maplet.name.encode())])
    return points[np.sort(generator.choice(len(points), most, replace=False))]


def _some(vertices: FloatArray, settings: AssessmentSettings) -> FloatArray:
    """Return at most `settings.vertices` of a mesh's vertices (N, 3)."""
    if len(vertices) <= settings.vertices:
        return vertices
    generator = np.random.default_rng(settings.seed)
    return vertices[np.sort(generator.choice(len(vertices), settings.vertices, replace=False))]
