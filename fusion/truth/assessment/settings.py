"""How much is looked at, and where the regions end."""

from __future__ import annotations

from dataclasses import dataclass

from spcola.errors import SettingsError


@dataclass(frozen=True)
class AssessmentSettings:
    """How a model is sampled, and how regions are told apart.

    Parameters
    ----------
    patches : int
        At most so many maplets (or patches of a mesh) have their heights compared, evenly taken
        from all.
    patch_half_size : int
        Larger maps are cut into squares of this half-size; of those, at most `patches` count.
    vertices : int
        At most so many vertices enter the 3D rms.
    fit_vertices : int
        At most so many of those enter the fit of translation and rotation.
    seed : int
        Of the choice of vertices.
    smallest : float
        Boulders from this diameter on make the region of boulders (craters likewise, see
        :meth:`spcola.truth.body.TruthBody.terrain`), metres.
    dark_share : float
        Ground that is lit for less than this share of a rotation is the region in shadow: by
        default where synthetic solutions lose their hold, too.
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
