"""Settings of the assessment: sampling of models, and limits of regions."""

from __future__ import annotations

from dataclasses import dataclass

from spcola.errors import SettingsError


@dataclass(frozen=True)
class AssessmentSettings:
    """Sampling of models, and limits of regions.

    Parameters
    ----------
    patches : int
        Most maplets (or patches of a mesh) whose heights are compared, evenly taken from all.
    patch_half_size : int
        Larger maps are cut into squares of this half-size; at most `patches` of them are compared.
    vertices : int
        Most vertices in the 3D rms.
    fit_vertices : int
        Most of those vertices in the fit of translation and rotation.
    seed : int
        Seed of the choice of vertices.
    smallest : float
        Smallest diameter in the region of boulders (and craters, see
        :meth:`spcola.truth.body.TruthBody.terrain`), metres.
    dark_share : float
        The shadowed region is lit for less than this share of a rotation. The default is that
        below which synthetic SPC solutions have no heights.
    """

    patches: int = 200
    patch_half_size: int = 64
    vertices: int = 40_000
    fit_vertices: int = 10_000
    seed: int = 0
    smallest: float = 1.5
    dark_share: float = 0.08

    def __post_init__(self) -> None:
        if min(self.patches, self.vertices, self.fit_vertices) < 1 or self.patch_half_size < 4:
            raise SettingsError("patches, their size and vertices must be positive", "assessment")
        if not (self.smallest > 0 and 0.0 <= self.dark_share <= 1.0):
            raise SettingsError("smallest or dark_share is out of range", "assessment")
