"""Physical ranges of the settings: the possible values of each quantity.

A number outside its range is a mistake (a unit, a sign, a power of ten), and would fail far from
where it was written, or be clipped silently. The ranges are wide: they exclude only what no
mission could mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field, GetCoreSchemaHandler
from pydantic_core import PydanticCustomError, core_schema


@dataclass(frozen=True)
class Span:
    """Least and largest value of a number, and whether 0 is allowed too.

    Parameters
    ----------
    low, high : float
        Both allowed.
    zero : bool
        Whether 0, below `low`, is allowed too: it means unknown, or chosen by the program.
    """

    low: float
    high: float
    zero: bool = False

    def __str__(self) -> str:
        return f"{'0, or ' if self.zero else ''}{self.low:g} to {self.high:g}"

    def holds(self, value: float) -> bool:
        """Return whether `value` is allowed."""
        return self.low <= value <= self.high or (self.zero and value == 0)

    def checked(self, value: float) -> float:
        """Return `value`, refused unless it is allowed."""
        if not self.holds(value):
            raise PydanticCustomError("range", "should be {span}", {"span": str(self)})
        return value

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        return core_schema.no_info_after_validator_function(self.checked, handler(source))


_SMALLEST_M, _LARGEST_M = 1e-3, 1e8
"""Sizes of bodies and places on them: a stone in a laboratory, and beyond Jupiter's radius."""

Fraction = Annotated[float, Span(0.0, 1.0)]
Size = Annotated[float, Span(_SMALLEST_M, _LARGEST_M, zero=True)]
"""Size of a body or a grid, or a distance from it, metres."""
Gsd = Annotated[float, Span(1e-4, 1e5, zero=True)]
"""Ground sample distance, metres."""
Reach = Annotated[float, Span(1e-4, 1e5)]
"""Reach of a search, metres."""
Sigma = Annotated[float, Span(1e-6, 1e5)]
"""Standard deviation of a length, metres: a micrometre is below every instrument."""
SigmaOrNone = Annotated[float, Span(1e-6, 1e5, zero=True)]
SigmaDegrees = Annotated[float, Span(1e-9, 90.0)]
"""Standard deviation of an angle, degrees: 1e-9 is a micrometre at 60 km."""
Sigmas = Annotated[float, Span(0.1, 1e9)]
"""A bound in standard deviations; a large one rejects nothing."""
Seconds = Annotated[float, Span(1e-3, 1e10)]
"""A time, s: up to three centuries."""
Angle = Annotated[float, Span(1e-3, 180.0)]
Latitude = Annotated[float, Span(-90.0, 90.0)]
Turn = Annotated[float, Span(-360.0, 360.0)]
Rate = Annotated[float, Span(-1e7, 1e7)]
"""Rotation rate, degrees per day: the fastest known body turns once in ten seconds."""
Tilt = Annotated[float, Span(-180.0, 180.0)]
Offset = Annotated[float, Span(-1e4, 1e4)]
"""Offset of a point on a spacecraft, or of a range, metres."""
Relative = Annotated[float, Span(-0.9, 0.9)]
Milliradians = Annotated[float, Span(1e-6, 1e3, zero=True)]

Cells = Annotated[int, Span(0, 10_000)]
"""Grid steps."""
Count = Annotated[int, Span(1, 1_000_000)]
Seed = Annotated[int, Span(0, 2**32 - 1)]
NaifNumber = Annotated[int, Span(-(2**31), 2**31 - 1)]

# Paths have no zero bytes.
Text = Annotated[str, Field(max_length=1000, pattern=r"^[^\x00]*$")]
"""A name, or a path."""
Texts = Annotated[list[Text], Field(max_length=1000)]


def range_text(annotation: Any, metadata: list[Any]) -> str:
    """Return the range of a setting's numbers for its comment; empty if it has no numbers."""
    spans = [one for one in metadata if isinstance(one, Span)]
    if not spans:
        # The span of the numbers in a list.
        inner = [one for part in getattr(annotation, "__args__", ()) for one in metadata_of(part)]
        spans = [one for one in inner if isinstance(one, Span)]
    return f" ({spans[0]})" if spans else ""


def metadata_of(annotation: Any) -> tuple[Any, ...]:
    """Return the metadata of an annotated type."""
    found: tuple[Any, ...] = getattr(annotation, "__metadata__", ())
    return found
