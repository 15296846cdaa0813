"""Settings of a body that may overhang."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError

_MOST_FACETS = 2.0e7
# Outside a fine site the longest edge grows by this share of the distance, metres a metre.
_GROWTH = 0.1
# Facets on a square whose side is the longest edge: edges are between half of it and all of it.
_PER_SQUARE = 2.0 / 0.57**2


@dataclass(frozen=True)
class FineSite:
    """A circle of ground whose mesh is as fine as the finest images.

    Parameters
    ----------
    latitude_deg, longitude_deg : float
        Direction to its middle.
    diameter : float
        Metres.
    spacing : float
        Longest edge inside, metres; outside edges become longer little by little.

    Raises
    ------
    SettingsError
        If a number lies outside its range.
    """

    latitude_deg: float
    longitude_deg: float
    diameter: float = 20.0
    spacing: float = 0.06

    def __post_init__(self) -> None:
        if not (abs(self.latitude_deg) <= 90 and min(self.diameter, self.spacing) > 0):
            raise SettingsError("latitude, diameter or spacing out of range", "fine site")

    @property
    def direction(self) -> FloatArray:
        """Unit vector (3,) to its middle."""
        latitude, longitude = np.radians([self.latitude_deg, self.longitude_deg])
        x, y = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
        # Rounded: sines differ in the last bit between the libraries of machines.
        return np.round(np.array([x, y, np.sin(latitude)]), 12)

    def longest_edges(self, middles: FloatArray) -> FloatArray:
        """Return the greatest length (N,), metres, of edges with these middles (N, 3)."""
        along = middles @ self.direction
        aside = np.sqrt(np.maximum(np.sum(middles**2, axis=1) - along**2, 0.0))
        outside = np.where(along > 0, np.maximum(aside - 0.5 * self.diameter, 0.0), np.inf)
        return self.spacing + _GROWTH * outside

    def facets(self, spacing: float) -> float:
        """Return the approximate number of facets in and around it, for edges of `spacing`."""
        r, s = 0.5 * self.diameter, self.spacing
        around = 2.0 * r / (_GROWTH * s) + 2.0 * np.log(max(spacing / s, 1.0)) / _GROWTH**2
        return float(_PER_SQUARE * np.pi * (r**2 / s**2 + around))


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
    sites : tuple of FineSite
        Where the mesh is as fine as the finest images.

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
    sites: tuple[FineSite, ...] = ()

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
        everywhere = 4.0 * np.pi * radius**2 * 1.2 * _PER_SQUARE / self.spacing**2
        return everywhere + sum(site.facets(self.spacing) for site in self.sites)
