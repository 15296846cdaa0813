"""A synthetic body that may overhang: a closed mesh, which is the truth itself."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import cached_property

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.grids import MapletGrid
from spcola.shape import Mesh, RayCaster
from spcola.truth.body import BOULDER, BodySettings, SurfacePoints, TruthBody
from spcola.truth.body.relief import PowerLaw
from spcola.truth.solid.base import closed_base
from spcola.truth.solid.mesh_surface import MeshSurface
from spcola.truth.solid.overhangs import STRETCH, Overhang
from spcola.truth.solid.placing import place_overhangs
from spcola.truth.solid.refining import SmoothMesh, refined, vertex_normals
from spcola.truth.solid.settings import SolidSettings
from spcola.truth.solid.sheets import nearest_sheet, sheets_of, single_sheet

# Facets along the side of a cube's face with which the smooth shape of the settings begins, at
# least; and their longest edges, over the mean radius, if there were one.
_FIRST_Q, _LONGEST = 24, 3.2


class SolidBody(TruthBody):
    """A body whose surface may have several radii in one direction.

    A base (a given mesh, or the smooth shape of the body's settings) is refined, displaced along
    its normals by the relief of the settings, and folded where boulders and cliffs overhang. The
    result is one closed mesh. It is the truth: queries are exact on its facets.

    What has several answers is not answered: :meth:`radius` and :meth:`heights` are NaN where
    several sheets of the surface lie one above the other.

    Parameters
    ----------
    settings : BodySettings
        Relief and albedo; with a given base `radius` should be its mean radius.
    solid : SolidSettings
    base : Mesh, optional
        A closed mesh, in metres, facets counter-clockwise seen from outside.

    Raises
    ------
    SettingsError
        If the mesh would have too many facets.
    InvalidValueError
        If the base is not closed.
    """

    def __init__(
        self,
        settings: BodySettings | None = None,
        solid: SolidSettings | None = None,
        *,
        base: Mesh | None = None,
    ) -> None:
        super().__init__(settings)
        self.solid = solid or SolidSettings()
        self.solid.check(self.settings.radius)
        smooth = self._refined_base(base)
        self.surface_mesh = self._folded(smooth)
        self.surface = MeshSurface(RayCaster(self.surface_mesh))

    def _refined_base(self, base: Mesh | None) -> SmoothMesh:
        """Return the base with short edges; draw the overhangs on the way."""
        solid = self.solid
        if base is None:
            bare = TruthBody(without_relief(self.settings))
            mesh = bare.mesh(_first_q(self.settings.radius / solid.spacing))
            first = SmoothMesh(mesh.vertices, bare.normals(mesh.vertices), mesh.facets)
        else:
            mesh = closed_base(base)
            normals = vertex_normals(mesh.vertices, mesh.facets)
            first = SmoothMesh(mesh.vertices, normals, mesh.facets)
        smooth = refined(
            first, lambda middle: np.full(len(middle), solid.spacing), curved=solid.curved
        )
        self.overhangs: tuple[Overhang, ...] = place_overhangs(smooth, self.settings, solid)
        return refined(smooth, self._longest_edges, curved=solid.curved)

    def _longest_edges(self, middles: FloatArray) -> FloatArray:
        """Return the greatest length (N,), metres, of edges with these middles (N, 3)."""
        longest = np.full(len(middles), self.solid.spacing)
        for feature in self.overhangs:
            # Edges that end inside have their middles at most half of one outside.
            inside = feature.patch.inside(middles, 0.5 * self.solid.spacing)
            longest[inside] = min(self.solid.spacing, feature.edge) / STRETCH
        for site in self.solid.sites:
            longest = np.minimum(longest, site.longest_edges(middles))
        return longest

    def _folded(self, smooth: SmoothMesh) -> Mesh:
        """Return the mesh with relief and overhangs."""
        inside = [feature.patch.inside(smooth.vertices) for feature in self.overhangs]
        left = np.full(len(smooth.vertices), self.solid.relief)
        for feature, rows in zip(self.overhangs, inside, strict=True):
            left[rows] *= feature.roughness_left(smooth.vertices[rows])
        vertices = smooth.vertices.copy()
        if self.solid.relief > 0:
            bare = TruthBody(without_relief(self.settings))
            height = TruthBody.radius(self, vertices) - bare.radius(vertices)
            vertices += (left * height)[:, None] * smooth.normals
        for feature, rows in zip(self.overhangs, inside, strict=True):
            vertices[rows] = feature.moved(vertices[rows])
        return Mesh(vertices, smooth.facets, name="truth")

    @cached_property
    def fingerprint(self) -> str:
        """Hexadecimal digest of the mesh and of albedos, to the last bit."""
        digest = hashlib.sha256(self.surface_mesh.vertices.astype("<f8").tobytes())
        digest.update(self.surface_mesh.facets.astype("<i8").tobytes())
        digest.update(self.albedo(self.surface_mesh.vertices[::997]).astype("<f8").tobytes())
        return digest.hexdigest()

    def radius(self, directions: FloatArray) -> FloatArray:
        """Return the radius (N,), metres, in the `directions` (N, 3); NaN where it has several."""
        beams = np.asarray(directions, dtype=np.float64)
        inner = self.surface.caster.cast(np.zeros(3), beams).distance
        outer = self.surface.radius(beams)
        return np.where(np.abs(outer - inner) < 1e-7 * self.settings.radius, outer, np.nan)

    def outermost_radius(self, directions: FloatArray) -> FloatArray:
        """Return the greatest radius (N,), metres, in the `directions` (N, 3)."""
        return self.surface.radius(directions)

    def normals(self, directions: FloatArray) -> FloatArray:
        """Return the outward unit normals (N, 3) of the outermost surface in the directions."""
        beams = np.asarray(directions, dtype=np.float64)
        return self.first_hits(self.surface.outside(beams), -beams).normals

    def cast(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Return the first hits (N, 3), metres, of rays; NaN where one misses.

        Parameters
        ----------
        origins, directions : (N, 3) ndarray
            As of :meth:`spcola.truth.body.TruthBody.cast`.
        """
        return self.surface.caster.cast(origins, directions).points

    def first_hits(self, origins: FloatArray, directions: FloatArray) -> SurfacePoints:
        """Return distance, points and outward normals of the first hits of rays.

        Parameters
        ----------
        origins, directions : (N, 3) ndarray
            As of :meth:`spcola.truth.body.TruthBody.cast`.
        """
        return self.surface.cast(origins, directions)

    def nearest(self, points: FloatArray) -> SurfacePoints:
        """Return the points of the surface nearest to `points` (N, 3), metres."""
        found = self.surface.caster.closest(points)
        return SurfacePoints(
            found.distance, found.points, self.surface.normals_at(found.points, found.facet)
        )

    def sheets(self, grid: MapletGrid) -> FloatArray:
        """Return all heights (K, 2q+1, 2q+1) along Uz that face it, the highest first; then NaN.

        Those within two of the grid's radii of its plane.
        """
        return sheets_of(self.surface.caster, grid)

    def heights(self, grid: MapletGrid) -> FloatArray:
        """Return the heights (2q+1, 2q+1) on `grid`, metres; NaN where there are several."""
        return single_sheet(self.sheets(grid))

    def heights_near(self, grid: MapletGrid, model: FloatArray) -> FloatArray:
        """Return the heights (2q+1, 2q+1) along Uz that a model's heights stand for, metres.

        Where there are several, the nearest to the model's; NaN where a second one is less than
        twice as far from it, or where the model has none.

        Parameters
        ----------
        grid : MapletGrid
        model : (2q+1, 2q+1) ndarray
            Heights on the grid, metres.
        """
        return nearest_sheet(self.sheets(grid), model)

    def mesh(self, q: int) -> Mesh:  # noqa: ARG002  # as of a body that is no mesh
        """Return the mesh itself, whatever `q`."""
        return self.surface_mesh

    def terrain(self, directions: FloatArray, *, smallest: float) -> AnyArray:
        """Return the terrain in the `directions` (N, 3): flags (N,) of uint8.

        As of the settings' relief, for features of at least `smallest` metres; BOULDER also on
        the circles of overhanging features, if the directions are points on the surface.
        """
        flags = super().terrain(directions, smallest=smallest)
        for feature in self.overhangs:
            flags[feature.patch.inside(np.asarray(directions))] |= BOULDER
        return flags


def _first_q(radius: float) -> int:
    """Return the Q of a mesh whose edges, halved some times, are just short enough.

    `radius` is the mean radius in units of the longest edge.
    """
    q = _LONGEST * radius
    while q >= 2 * _FIRST_Q:
        q /= 2.0
    return max(2, int(np.ceil(q)))


def without_relief(settings: BodySettings) -> BodySettings:
    """Return the settings of the smooth body."""
    none = PowerLaw(0.0, 2.7, 1.0, 2.0)
    return replace(settings, roughness=0.0, craters=none, boulders=none, smallest_rock=None)
