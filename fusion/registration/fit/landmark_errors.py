"""Effect of the errors of landmarks on the matches of mapolas to the maplets around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spcola.arrays import FloatArray
from spcola.control.bundle_adjustment import Network
from spcola.math.statistics import strongest

# A pattern that displaces the mapolas by less (root of the sum of squares, metres) is smaller than
# the error of a single match, and counts as an independent error of each landmark.
_LEAST = 0.02


@dataclass(frozen=True, eq=False)
class LandmarkErrors:
    """Errors of the centres of maplets to which N mapolas are matched.

    Attributes
    ----------
    offset : (N, 3) ndarray
        Estimated error of each, body-fixed, metres; 0 where images do not determine it.
    own : (N, 3, 3) ndarray
        Residual covariance of each, square metres.
    shared : (N, 3, K) ndarray
        Patterns of shared errors, of standard deviation 1, metres.
    pixel_sigma : float
        Of the landmarks' positions in images, pixels.
    images, positions : int
        Number of images used, and of positions of landmarks in them.
    """

    offset: FloatArray
    own: FloatArray
    shared: FloatArray
    pixel_sigma: float
    images: int
    positions: int

    @classmethod
    def of_mapolas(
        cls, network: Network, names: Sequence[str], center_sigma: float
    ) -> LandmarkErrors:
        """Errors for the mapolas `names`; `center_sigma`, metres, for those without a landmark.

        Parameters
        ----------
        network : Network
            Solved landmarks.
        names : sequence of str
        center_sigma : float
        """
        row = {name: number for number, name in enumerate(network.names)}
        known = np.array([name in row for name in names], dtype=np.bool_)
        rows = np.array([row[name] for name in names if name in row], dtype=np.intp)
        kept, rest = strongest(network.shared[rows], least=_LEAST)
        offset = np.zeros((len(names), 3))
        own = np.tile(center_sigma**2 * np.eye(3), (len(names), 1, 1))
        shared = np.zeros((len(names), 3, kept.shape[2]))
        offset[known], own[known] = network.offset[rows], network.own[rows] + rest
        shared[known] = kept
        return cls(offset, own, shared, network.pixel_sigma, network.images, network.seen)

    def as_json(self) -> dict[str, Any]:
        """Return its numbers as ``registration.json`` has them."""
        return {
            "images": self.images,
            "seen": self.positions,
            "pixel_sigma": self.pixel_sigma,
            "patterns": self.shared.shape[2],
            "offset_rms_m": float(np.sqrt(np.mean(self.offset**2))),
            "own_sigma_m": float(np.sqrt(np.mean(np.trace(self.own, axis1=1, axis2=2)) / 3.0)),
        }
