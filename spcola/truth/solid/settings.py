"""Settings of a body that may overhang."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.errors import SettingsError

_MOST_FACETS = 2.0e7


@dataclass(frozen=True)
class SolidSettings:
    """The mesh of a body, its overhanging boulders and its cliffs.

    Parameters
    ----------
    spacing : float
        Longest edge of the mesh, metres; shorter where boulders and cliffs stretch it.
    relief : float
        Share of the relief of the body's settings (roughness, craters, boulders) that is added
        to the base along its normals; 0 for the base alone.
    curved : bool
        Whether the base is curved between its vertices (cubic along the edges, through the
        vertices, at right angles to their normals), or has flat facets.
    boulders : int
        Number of boulders with undercut sides.
    smallest, largest : float
        Their longest axes, metres.
    reach_deg : float
        Angle from the top of a boulder, seen from its middle, down to the ground: beyond 90° its
        sides overhang.
    roughness : float
        Irregularity of the boulders, as a share of their size.
    cliffs : int
        Number of overhanging cliffs.
    cliff_length, cliff_height, cliff_overhang : float
        Length along the edge, height, and how far the edge leans out, metres.

    Raises
    ------
    SettingsError
        If a number lies outside its range.
    """

    spacing: float = 0.7
    relief: float = 1.0
    curved: bool = True
    boulders: int = 24
    smallest: float = 6.0
    largest: float = 25.0
    reach_deg: float = 140.0
    roughness: float = 0.1
    cliffs: int = 3
    cliff_length: float = 60.0
    cliff_height: float = 8.0
    cliff_overhang: float = 5.0

    def __post_init__(self) -> None:
        if not 0 < self.spacing < np.inf:
            raise SettingsError(f"must be positive, not {self.spacing} m", "spacing of the mesh")
        if min(self.boulders, self.cliffs) < 0 or not 0 < self.smallest <= self.largest:
            raise SettingsError("number or sizes out of range", "overhanging boulders")
        if not 30 <= self.reach_deg <= 165 or not 0 <= self.roughness <= 0.2:
            raise SettingsError("reach must be 30 … 165°, roughness 0 … 0.2", "boulders")
        if min(self.cliff_length, self.cliff_height, self.cliff_overhang) <= 0 or self.relief < 0:
            raise SettingsError("lengths must be positive, relief ≥ 0", "cliffs or relief")

    def check(self, radius: float) -> None:
        """Refuse a mesh of too many facets for a body of mean `radius`, metres.

        Raises
        ------
        SettingsError
        """
        if self.facets(radius) > _MOST_FACETS:
            raise SettingsError(
                f"{self.facets(radius):.2g} facets are too many", "solid.spacing",
                "choose a larger spacing",
            )  # fmt: skip

    def facets(self, radius: float) -> float:
        """Return the approximate number of facets on a body of mean `radius`, metres."""
        # Edges between half of the spacing and all of it; triangles of a cube's grid.
        return 4.0 * np.pi * radius**2 * 1.2 / (0.5 * (0.57 * self.spacing) ** 2)
