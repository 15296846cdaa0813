"""3D rms: distances of a model's vertices from the truth, before and after a rigid motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.truth.assessment.rigid import RigidFit, RigidOptions, fit_rigid
from fusion.truth.assessment.settings import AssessmentSettings
from spcola.arrays import FloatArray
from spcola.math import lattice
from spcola.shape import Mesh
from spcola.truth.body import TruthBody
from spcola.truth.solid import SolidBody

_CENTRE_DIRECTIONS = 200_000
# The area vectors of a closed surface cancel to within this share of its area.
_CLOSED = 1e-6


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances from the vertices of a model to the nearest points of the truth.

    Attributes
    ----------
    count : int
        Number of vertices.
    mean : float
        Signed mean, metres: positive where the model lies outside.
    rms : float
        3D rms of the model in its own coordinates, metres.
    largest : float
        Largest distance, metres.
    rms_without_offset : float
        After the translation that minimises it: without the offset of the centre, metres.
    rms_optimised : float
        After the translation and rotation that minimise it: the optimised 3D rms, metres.
    translation, rigid : RigidFit
        These two motions.
    center_of_figure : (3,) ndarray
        Centre of figure of the model minus that of the truth, metres; NaN unless the model is a
        closed mesh.
    """

    count: int
    mean: float
    rms: float
    largest: float
    rms_without_offset: float
    rms_optimised: float
    translation: RigidFit
    rigid: RigidFit
    center_of_figure: FloatArray


def measure_distances(
    vertices: FloatArray, truth: TruthBody, settings: AssessmentSettings, mesh: Mesh | None
) -> Distances:
    """Measure the 3D rms of `vertices` (N, 3), metres, body-fixed coordinates.

    The motions are fitted to an even selection of `settings.fit_vertices`; all three rms are
    over all `vertices`.
    """
    # A writable copy: kernels would be compiled again for read-only arrays.
    vertices = np.array(vertices, dtype=np.float64)
    some = vertices[:: max(1, -(-len(vertices) // settings.fit_vertices))]
    translation = fit_rigid(some, truth, options=RigidOptions(rotation=False))
    rigid = fit_rigid(some, truth)
    plain = truth.nearest(vertices).distance
    apart = np.full(3, np.nan)
    if mesh is not None and _is_closed(mesh):
        apart = center_of_figure(mesh) - truth_center(truth)
    return Distances(
        len(vertices),
        float(np.mean(plain)) if len(plain) else float("nan"),
        _rms(plain),
        float(np.max(np.abs(plain), initial=0.0)) if len(plain) else float("nan"),
        _rms(truth.nearest(translation.apply(vertices)).distance),
        _rms(truth.nearest(rigid.apply(vertices)).distance),
        translation,
        rigid,
        apart,
    )


def center_of_figure(mesh: Mesh) -> FloatArray:
    """Return the centroid (3,) of the volume that a closed mesh encloses, metres."""
    a, b, c = mesh.corners.transpose(1, 0, 2)
    volume = np.sum(np.cross(a, b) * c, axis=1)
    center: FloatArray = volume @ (a + b + c) / (4.0 * volume.sum())
    return center


def truth_center(truth: TruthBody) -> FloatArray:
    """Return the centroid (3,) of the truth's volume, metres: ∫ r⁴ û / 4 over ∫ r³ / 3."""
    if isinstance(truth, SolidBody):
        return center_of_figure(truth.surface_mesh)
    directions = lattice(_CENTRE_DIRECTIONS)
    radius = truth.radius(directions)
    center: FloatArray = 0.75 * (radius**4) @ directions / np.sum(radius**3)
    return center


def _is_closed(mesh: Mesh) -> bool:
    area = float(np.linalg.norm(mesh.area_vectors, axis=1).sum())
    open_by = float(np.linalg.norm(mesh.area_vectors.sum(axis=0)))
    return area > 0 and mesh.volume > 0 and open_by < _CLOSED * area


def _rms(distance: FloatArray) -> float:
    return float(np.sqrt(np.mean(distance**2))) if len(distance) else float("nan")
