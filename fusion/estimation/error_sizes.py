"""Sizes of errors that are part of the question."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray


@dataclass(frozen=True)
class ErrorSizes:
    """Sizes of the errors that single observations cannot know, in the unit of the values.

    As a prior, each is the median of a log-normal distribution that is `width` wide (standard
    deviation of the natural logarithm); a size of 0 is held at 0, and a width of 0 holds all.
    `shared` has one size for each group of effects; those of the groups numbered in `held` stay as
    they are.
    """

    independent: float
    shared: tuple[float, ...] = ()
    width: float = 1.0
    held: tuple[int, ...] = ()

    @property
    def all(self) -> FloatArray:
        """The sizes (1 + G,): independent, then those of the groups."""
        return np.array([self.independent, *self.shared])
