"""Some of the items of a stage: by name, or around a place on the body."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import astuple, dataclass
from difflib import get_close_matches
from typing import Any, Protocol, TypeVar

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError
from spcola.shape.tiling import Circle

Value = TypeVar("Value")


@dataclass(frozen=True)
class Place:
    """A circle on the body.

    Parameters
    ----------
    latitude_deg, longitude_deg : float
        Planetocentric, degrees; longitude east.
    radius_m : float
        Metres along the surface.

    Raises
    ------
    InvalidValueError
        If a number is impossible.
    """

    latitude_deg: float
    longitude_deg: float
    radius_m: float

    def __post_init__(self) -> None:
        numbers = (self.latitude_deg, self.longitude_deg, self.radius_m)
        if not np.isfinite(numbers).all() or abs(self.latitude_deg) > 90 or self.radius_m <= 0:
            raise InvalidValueError(
                f"{numbers} is no latitude, longitude and radius",
                do="give LAT,LON,RADIUS_M: degrees and metres, such as 45,120,30",
            )

    @classmethod
    def parse(cls, text: str) -> Place:
        """Return the place of a text ``LAT,LON,RADIUS_M``.

        Raises
        ------
        InvalidValueError
            If it is none.
        """
        try:
            latitude, longitude, radius = (float(part) for part in text.split(","))
        except ValueError as error:
            raise InvalidValueError(
                f"{text!r} is no place", do="give LAT,LON,RADIUS_M, such as 45,120,30"
            ) from error
        return cls(latitude, longitude, radius)

    def holds(self, center: FloatArray) -> bool:
        """Return whether a body-fixed point (3,), metres, lies within the circle."""
        return bool(self.circle.holds(center))

    @property
    def circle(self) -> Circle:
        """The same, in metres and as a direction."""
        lat, lon = np.radians([self.latitude_deg, self.longitude_deg])
        up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
        return Circle(up, self.radius_m)


@dataclass(frozen=True)
class Subset:
    """Which items of a stage are made; the others stay as they are.

    Parameters
    ----------
    names : frozenset of str
        Empty: any.
    place : Place, optional
        Anywhere if not given.
    """

    names: frozenset[str] = frozenset()
    place: Place | None = None

    @classmethod
    def of(cls, names: Iterable[str] = (), within: str = "") -> Subset:
        """Return the subset of names and of a place ``LAT,LON,RADIUS_M``; both may be empty.

        Raises
        ------
        InvalidValueError
            If the place is none.
        """
        return cls(frozenset(names), Place.parse(within) if within else None)

    def as_json(self) -> dict[str, Any]:
        """Return it in JSON types."""
        return {
            "only": sorted(self.names),
            "within": None if self.place is None else list(astuple(self.place)),
        }

    def __bool__(self) -> bool:
        """Return whether anything is left out."""
        return bool(self.names) or self.place is not None

    def chosen(
        self, items: Mapping[str, Value], centers: Mapping[str, FloatArray] | None = None
    ) -> dict[str, Value]:
        """Return the chosen items, in their order.

        Parameters
        ----------
        items : mapping
            All items of the stage by name.
        centers : mapping of str to (3,) ndarray, optional
            Where each lies, body-fixed, metres; an item without a place is in every circle.

        Raises
        ------
        InvalidValueError
            If a name is not among them, or none is chosen.
        """
        self._check_names(items)
        places = centers or {}
        found = {
            name: item
            for name, item in items.items()
            if (not self.names or name in self.names)
            and (self.place is None or name not in places or self.place.holds(places[name]))
        }
        if not found:
            raise InvalidValueError(f"leave none of {len(items)} items", "--only and --within")
        return found

    def _check_names(self, known: Iterable[str]) -> None:
        names = list(known)
        for name in sorted(self.names - set(names)):
            near = get_close_matches(name, names, 1)
            hint = f"did you mean {near[0]}?" if near else f"there are {len(names)} others"
            raise InvalidValueError(f"{name!r} is not there", "--only", hint)


class Named(Protocol):
    """A result that states its name."""

    @property
    def name(self) -> str:
        """Name of the item."""
        ...


Result = TypeVar("Result", bound=Named)


def with_kept(
    names: Iterable[str],
    chosen: Collection[str],
    made: Iterator[Result],
    kept: Callable[[str], Result | None],
) -> Iterator[Result]:
    """Yield the results of chosen items, and those of the others that an earlier run left.

    Parameters
    ----------
    names : iterable of str
        Of all items, in order.
    chosen : collection of str
        Those that are made, in the same order.
    made : iterator
        Their results in this order; some may have none.
    kept : callable
        Reads the result of an item that is not made; None if there is none.
    """
    coming = next(made, None)
    for name in names:
        if name in chosen:
            if coming is not None and coming.name == name:
                yield coming
                coming = next(made, None)
        elif (before := kept(name)) is not None:
            yield before
