"""A photometric function with its parameters: a value."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError
from spcola.photometry.functions.kernel import PACKED, Code, shade_parameters, shade_points


@dataclass(frozen=True)
class Parameter:
    """A parameter of a photometric function.

    Parameters
    ----------
    name : str
    default, lower, upper : float
        In its unit; bounds are allowed values.
    unit : str
        Empty for a pure number.
    slot : int
        Its place in :attr:`PhotometricFunction.packed`.
    about : str
    """

    name: str
    default: float
    lower: float
    upper: float
    unit: str
    slot: int
    about: str


@dataclass(frozen=True, eq=False)
class Partials:
    """Brightness with its derivatives by the cosines of incidence and emission, of one shape."""

    value: FloatArray
    by_cos_incidence: FloatArray
    by_cos_emission: FloatArray


@dataclass(frozen=True)
class PhotometricFunction:
    """Brightness Φ of ground by the cosines of incidence and emission and the phase angle [16, 17].

    Φ is 1 at normal incidence and emission and zero phase, for all parameters. A phase function is
    part of it: the factor λ of each image absorbs most of that. Ground that the light or the view
    does not reach (a cosine ≤ 0) has brightness 0; NaN stays NaN. The cosines and the phase must be
    angles between three directions: Akimov's and the rough Hapke function have no value for others.

    Parameters
    ----------
    name : str
    code : Code
        The formula, for kernels.
    parameters : tuple of Parameter
    values : tuple of float
        One for each parameter.
    base : tuple of float
        The eight numbers of `packed` where no parameter has its place.

    Raises
    ------
    SettingsError
        If a value lies outside its bounds.
    """

    name: str
    code: Code
    parameters: tuple[Parameter, ...]
    values: tuple[float, ...]
    base: tuple[float, ...] = (0.0,) * PACKED

    def __post_init__(self) -> None:
        for one, value in zip(self.parameters, self.values, strict=True):
            if not (math.isfinite(value) and one.lower <= value <= one.upper):
                raise SettingsError(
                    f"must be {one.lower:g} to {one.upper:g}, not {value:g}",
                    f"{one.name} of the photometric function {self.name}",
                )

    @cached_property
    def packed(self) -> FloatArray:
        """The parameters (8,) as kernels take them."""
        packed = np.array(self.base, dtype=np.float64)
        for one, value in zip(self.parameters, self.values, strict=True):
            packed[one.slot] = value
        packed.setflags(write=False)
        return packed

    def having(self, values: Mapping[str, float]) -> PhotometricFunction:
        """Return the function with some parameters changed.

        Parameters
        ----------
        values : mapping
            By the names of parameters.

        Raises
        ------
        SettingsError
            If it has no such parameter, or a value lies outside its bounds.
        """
        names = [one.name for one in self.parameters]
        for name in values:
            if name not in names:
                known = f"it has {', '.join(names)}" if names else "it has none"
                raise SettingsError(
                    f"is no parameter of the photometric function {self.name}", name, known
                )
        old = zip(names, self.values, strict=True)
        return replace(self, values=tuple(float(values.get(name, value)) for name, value in old))

    def fixing(self, names: Collection[str]) -> PhotometricFunction:
        """Return the function with some parameters fixed: they are no longer among its own.

        Parameters
        ----------
        names : collection of str
            Of parameters; others are ignored.
        """
        left = [one.name not in names for one in self.parameters]
        return replace(
            self,
            parameters=tuple(compress(self.parameters, left)),
            values=tuple(compress(self.values, left)),
            base=tuple(self.packed.tolist()),
        )

    @property
    def text(self) -> str:
        """The function as settings have it: its name, then its parameters."""
        values = zip(self.parameters, self.values, strict=True)
        return " ".join([self.name, *(f"{one.name}={value:.8g}" for one, value in values)])

    def __call__(
        self, cos_incidence: FloatArray, cos_emission: FloatArray, phase: FloatArray
    ) -> FloatArray:
        """Return Φ; the arrays are broadcast to one shape, `phase` is in radians."""
        return self.partials(cos_incidence, cos_emission, phase).value

    def partials(
        self, cos_incidence: FloatArray, cos_emission: FloatArray, phase: FloatArray
    ) -> Partials:
        """Return Φ and its derivatives by the cosines; 0 in the dark.

        Parameters
        ----------
        cos_incidence, cos_emission : ndarrays
        phase : ndarray
            Radians.
        """
        cosines, angle, shape = _points(cos_incidence, cos_emission, phase)
        found = np.empty((3, angle.size))
        shade_points(int(self.code), self.packed, cosines, angle, found)
        value, by_i, by_e = found.reshape(3, *shape)
        return Partials(value, by_i, by_e)

    def by_parameters(
        self, cos_incidence: FloatArray, cos_emission: FloatArray, phase: FloatArray
    ) -> FloatArray:
        """Return the derivatives (P, …) of Φ by its parameters, exact; 0 in the dark.

        Parameters
        ----------
        cos_incidence, cos_emission : ndarrays
        phase : ndarray
            Radians.
        """
        cosines, angle, shape = _points(cos_incidence, cos_emission, phase)
        found = np.empty((len(self.parameters), angle.size))
        slots = np.array([one.slot for one in self.parameters], dtype=np.int64)
        shade_parameters(int(self.code), self.packed, slots, cosines, angle, found)
        return found.reshape(-1, *shape)


def _points(*given: FloatArray) -> tuple[FloatArray, FloatArray, tuple[int, ...]]:
    """Return cosines (2, N), phase (N,) and the shape that all have in common."""
    all_ = np.broadcast_arrays(*(np.asarray(one, dtype=np.float64) for one in given))
    # Copies: compiled code may not be given views of broadcast arrays.
    return np.stack([one.ravel() for one in all_[:2]]), np.array(all_[2]).ravel(), all_[2].shape
