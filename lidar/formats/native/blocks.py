"""Blocks: some hundred thousand returns of a scan as compact layers, and back.

| layer | type | what |
|---|---|---|
| cube, start | i8 (T, 3), i8 (T + 1) | occupied lattice cubes, and their rows |
| place | u8 (N) | place of a return in its cube (:mod:`lidar.scans.cubes.cubes`) |
| time | u4 (N) | steps of ``time_step`` s after ``time_start`` |
| range | u4 (N) | steps of ``range_step`` m |
| sigma, intensity | f4 (N) | metres, instrument units |
| flag | i4 (N) | as in the file |
| flight_time, flight_position | f8 (K), f8 (K, 3) | knots of the spacecraft's path |
| spacecraft | f8 (N, 3) | where that path is too rough for knots |
| beam | f8 (N, 3) | where it does not point from spacecraft to return |

A layer that is one number throughout, or unknown (NaN), is an attribute instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from lidar.formats.native.positions import Flight, fit_flight
from lidar.scans import Scan
from lidar.scans.cubes import QUANTUM_M, CubedPoints, sort_into_cubes
from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.compilation import compiled

KNOTS = frozenset({"flight_time", "flight_position"})
"""Layers without a row for each return or cube."""
LAYERS: Mapping[str, tuple[str, str, tuple[int, ...]]] = MappingProxyType(
    {
        "cube": ("<i8", "cubes", (3,)),
        "start": ("<i8", "starts", ()),
        "place": ("<u8", "returns", ()),
        "time": ("<u4", "returns", ()),
        "range": ("<u4", "returns", ()),
        "sigma": ("<f4", "returns", ()),
        "intensity": ("<f4", "returns", ()),
        "flag": ("<i4", "returns", ()),
        "flight_time": ("<f8", "knots", ()),
        "flight_position": ("<f8", "knots", (3,)),
        "spacecraft": ("<f8", "returns", (3,)),
        "beam": ("<f8", "returns", (3,)),
    }
)
"""For each layer the type on disk, the meaning of its rows, and the shape of one row."""
_SPECIAL = KNOTS | {"cube", "start", "place"}
# The largest number marks missing values.
_UNKNOWN = np.iinfo(np.uint32).max
_LEAST_TIME_STEP_S = 1e-6
# The spacecraft moves by centimetres a second around small bodies, by kilometres around planets: an
# error of its path below this fraction of a quantum leaves the beam unchanged.
_FLIGHT_TOLERANCE_M = 0.2 * QUANTUM_M


@dataclass(frozen=True, eq=False)
class Block:
    """Layers and numbers of a block, with the names in the table above.

    Attributes
    ----------
    layers : mapping of str to ndarray
    numbers : mapping of str to float
        Steps, starts and constants.
    """

    layers: Mapping[str, AnyArray]
    numbers: Mapping[str, float]

    @property
    def cubes(self) -> CubedPoints:
        """Places of the returns."""
        layers = self.layers
        return CubedPoints(
            int(self.numbers["bits"]), layers["cube"], layers["start"], layers["place"]
        )

    def part(self, begin: int, end: int) -> Block:
        """Return the rows `begin` to `end` as a block of their own."""
        cubes = self.cubes.part(begin, end)
        whole = {name: self.layers[name] for name in KNOTS if name in self.layers}
        rows = {name: self.layers[name][begin:end] for name in self.layers if name not in _SPECIAL}
        layers = {**rows, **whole, "cube": cubes.cube, "start": cubes.start, "place": cubes.place}
        return Block(layers, self.numbers)


def encode(scan: Scan) -> Block:
    """Sort a chunk of a scan into cubes and compress its layers."""
    cubes, order = sort_into_cubes(scan.points)
    encoder = _Encoder(cubes, order)
    encoder.put_counted("time", scan.time, _LEAST_TIME_STEP_S)
    encoder.put_counted("range", scan.range, QUANTUM_M)
    encoder.put("sigma", scan.sigma.astype(np.float32))
    encoder.put("intensity", scan.intensity.astype(np.float32))
    encoder.put("flag", scan.flag.astype(np.int32))
    encoder.put_path(scan.time, scan.spacecraft)
    if np.isfinite(scan.beam).any() and not _is_along(scan.beam, scan.points, scan.spacecraft):
        encoder.layers["beam"] = scan.beam[order]
    return Block(encoder.layers, encoder.numbers)


class _Encoder:
    """Layers and numbers of a block whose returns are sorted into `cubes` by `order` (N,)."""

    def __init__(self, cubes: CubedPoints, order: IntArray) -> None:
        self.layers: dict[str, AnyArray] = {
            "cube": cubes.cube,
            "start": cubes.start,
            "place": cubes.place,
        }
        self.numbers: dict[str, float] = {"bits": cubes.bits}
        self._order = order

    def put(self, name: str, values: AnyArray) -> None:
        """Store a layer, or its value if that is constant."""
        if len(values) == 0 or (values == values[0]).all():
            self.numbers[name] = float(values[0]) if len(values) else 0.0
        elif not np.isnan(values).all():
            self.layers[name] = values[self._order]

    def put_counted(self, name: str, values: FloatArray, step: float) -> None:
        """Store a layer as whole steps from its least value; nothing if it is unknown."""
        start, last = _known_span(values)
        if not start <= last:
            return
        while (last - start) / step >= _UNKNOWN - 1:
            step *= 10.0
        self.layers[name] = _counted_steps(values, self._order, start, step)
        self.numbers[f"{name}_start"], self.numbers[f"{name}_step"] = start, step

    def put_path(self, time: FloatArray, spacecraft: FloatArray) -> None:
        """Store the spacecraft's positions, as knots if a spline fits them."""
        if np.isnan(spacecraft).all():
            return
        flight = fit_flight(time, spacecraft, _FLIGHT_TOLERANCE_M)
        if flight is None:
            self.layers["spacecraft"] = spacecraft[self._order]
        else:
            self.layers["flight_time"] = flight.time
            self.layers["flight_position"] = flight.position


def decode(block: Block, name: str, *, trajectory: str, body: str) -> Scan:
    """Return the scan in a block, its returns sorted by cube."""
    layers, numbers = block.layers, block.numbers
    points = block.cubes.points()
    count = len(points)
    time = times_of(block)
    if "flight_time" in layers:
        flight = Flight(layers["flight_time"], layers["flight_position"])
        # A time is rounded, and may lie half a step beyond the last knot.
        spacecraft = flight.at(np.clip(time, flight.time[0], flight.time[-1]))
    else:
        spacecraft = layers.get("spacecraft", np.full((count, 3), np.nan))

    def plain(layer: str) -> FloatArray:
        constant = np.full(count, numbers.get(layer, np.nan))
        return np.asarray(layers.get(layer, constant), dtype=np.float64)

    return Scan(
        name=name,
        time=time,
        range=_counted(block, "range"),
        spacecraft=np.asarray(spacecraft),
        beam=np.asarray(layers.get("beam", _directions(points - spacecraft))),
        points=points,
        intensity=plain("intensity"),
        flag=plain("flag").astype(np.int64),
        sigma=plain("sigma"),
        trajectory=trajectory,
        body=body,
    )


def spacecraft_knots(block: Block) -> tuple[FloatArray, FloatArray]:
    """Return times (K,), s, and positions (K, 3), m, from which the spacecraft's path follows."""
    layers = block.layers
    if "flight_time" in layers:
        return np.asarray(layers["flight_time"]), np.asarray(layers["flight_position"])
    if "spacecraft" not in layers:
        return np.empty(0), np.empty((0, 3))
    time, position = times_of(block), np.asarray(layers["spacecraft"])
    known = np.isfinite(time) & np.isfinite(position).all(axis=1)
    return time[known], position[known]


def times_of(block: Block, rows: IntArray | slice = slice(None)) -> FloatArray:
    """Return the ephemeris times (N,), s, of the returns `rows` of a `block`; NaN where unknown."""
    return _counted(block, "time", rows)


@compiled
def _known_span(values: FloatArray) -> tuple[float, float]:
    """Least and greatest finite value; inf and −inf if there is none."""
    least, greatest = np.inf, -np.inf
    for value in values:
        if np.isfinite(value):
            least, greatest = min(least, value), max(greatest, value)
    return least, greatest


@compiled
def _counted_steps(values: FloatArray, order: IntArray, start: float, step: float) -> IntArray:
    """Whole steps (N,) from `start`, in the given order."""
    steps = np.empty(len(order), dtype=np.uint32)
    for n in range(len(order)):
        value = values[order[n]]
        known = np.isfinite(value)
        steps[n] = np.uint32(np.rint((value - start) / step)) if known else np.uint32(_UNKNOWN)
    return steps


def _counted(block: Block, name: str, rows: IntArray | slice = slice(None)) -> FloatArray:
    """Return the values stored by :meth:`_Encoder.put_counted`."""
    if name not in block.layers:
        return np.full(len(block.layers["place"][rows]), np.nan)
    steps = block.layers[name][rows]
    values = block.numbers[f"{name}_start"] + steps * block.numbers[f"{name}_step"]
    values[steps == _UNKNOWN] = np.nan
    return values


@compiled
def _is_along(beam: FloatArray, points: FloatArray, spacecraft: FloatArray) -> bool:
    """Return whether every beam points from the spacecraft to its return, within a quantum."""
    for n in range(len(points)):
        square = 0.0
        for axis in range(3):
            square += (points[n, axis] - spacecraft[n, axis]) ** 2
        distance = np.sqrt(square)
        for axis in range(3):
            away = points[n, axis] - spacecraft[n, axis]
            if not abs(beam[n, axis] * distance - away) <= QUANTUM_M:
                return False
    return True


def _directions(away: FloatArray) -> FloatArray:
    """Unit vectors (N, 3); NaN where there is no direction."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead: FloatArray = away / np.linalg.norm(away, axis=1, keepdims=True)
    return ahead
