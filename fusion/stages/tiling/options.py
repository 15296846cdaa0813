"""Options of ``spcola spc tile``."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

from fusion.pipeline import Subset
from fusion.stages.tiling.naming import check_letters
from spcola.errors import SettingsError
from spcola.shape.tiling import Circle

SeedKind = Literal["maplets", "shape"]


@dataclass(frozen=True)
class TilingOptions:
    """What maplets are made.

    Parameters
    ----------
    gsd_m : float
        Their GSD, metres.
    half_size : int
        Their q.
    overlap : float
        Share of a side that neighbours have in common, in the mean, 0 … 0.8.
    region : Subset
        Its place is tiled; the whole body if it has none.
    source : {"maplets", "shape"}
        Where heights come from: coarser maplets and, where none reaches, the shape; or the
        shape alone.
    letters : str
        First two letters of the names; free ones if empty.
    replace : bool
        Whether the coarser maplets that lie wholly in the region leave the solution.
    sigma_m : float, optional
        One standard deviation of each coordinate of V, metres.
    max_images : int
        Most images of a maplet.

    Raises
    ------
    SettingsError
        If a value is impossible.
    """

    gsd_m: float
    half_size: int = 49
    overlap: float = 0.33
    region: Subset = field(default_factory=Subset)
    source: SeedKind = "maplets"
    letters: str = ""
    replace: bool = False
    sigma_m: float | None = None
    max_images: int = 50

    def __post_init__(self) -> None:
        for name, value in (("--gsd", self.gsd_m), ("--sigma", self.sigma_m)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise SettingsError(f"must be positive, not {value:g} m", name, "give metres")
        if not 0 <= self.overlap <= 0.8:
            raise SettingsError(f"must lie between 0 and 0.8, not {self.overlap:g}", "--overlap")
        check_letters(self.letters)

    @property
    def circle(self) -> Circle | None:
        """The region; None for the whole body."""
        return None if self.region.place is None else self.region.place.circle

    def as_json(self) -> dict[str, Any]:
        """Return them in JSON types, without letters."""
        return {
            "gsd_m": self.gsd_m,
            "half_size": self.half_size,
            "overlap": self.overlap,
            "within": self.region.as_json()["within"],
            "source": self.source,
            "replace": self.replace,
            "sigma_m": self.sigma_m,
            "max_images": self.max_images,
        }
