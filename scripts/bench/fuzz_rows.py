"""Points of all good files, and rows of the altimeters' published tables, column by column."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from spcola.navigation import et_from_utc

COUNT = 12
RNG = np.random.default_rng(7)
POINTS = RNG.normal(size=(COUNT, 3)) * 40.0 + [250.0, 0.0, 0.0]
CRAFT = POINTS * 3.5
TIMES = 6e8 + np.arange(COUNT)


def utc(index: int) -> str:
    return f"2005-09-12T02:53:{15 + index:02d}.125"


def place(index: int, radius: float) -> tuple[float, float, np.ndarray]:
    longitude, latitude = 40.0 + index, -12.0 + 0.5 * index
    return longitude, latitude, cartesian(longitude, latitude, radius + index)


def cartesian(longitude: float, latitude: float, radius: float) -> np.ndarray:
    lon, lat = np.radians([longitude, latitude])
    unit = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    return radius * np.array(unit)


def hayabusa(index: int) -> str:
    *_, surface = place(index, 160.0)
    craft = np.array([9e3, 8e3 + index, -2e3])
    line = f"{3000000 + index:10d} {utc(index)} {np.linalg.norm(surface - craft) / 1e3:8.5f}"
    line += "".join(f" {value / 1e3:9.5f}" for value in (*craft, *surface))
    return f"{line} {' '.join(['1.23456'] * 22)}".ljust(289) + "\r\n"


def hayabusa2(index: int) -> str:
    longitude, latitude, surface = place(index, 450.0)
    craft = np.array([1e4, 16e3 + index, -1280.0])
    values = [np.linalg.norm(surface - craft), longitude, latitude, 450.0 + index, *surface, *craft]
    return ",".join([utc(index), *(f"{value:.3f}" for value in values)]) + "\n"


def nlr(index: int) -> str:
    longitude, latitude, surface = place(index, 8000.0)
    seen = (44.0 + index, -10.0, 50e3)
    fields = [
        *(f"{longitude:.5f}", f"{latitude:.5f}", f"{8000.0 + index:.3f}"),
        *(f"{et_from_utc(utc(index)):.3f}", utc(index)),
        *(f"{np.linalg.norm(surface - cartesian(*seen)):.2f}", "1", "0"),
        *(f"{seen[0]:.5f}", f"{seen[1]:.5f}", f"{seen[2]:.2f}"),
        *("1.25", "0.50", "3043423444"),
        *(f"{value:.2f}" for value in surface),
        *("0.5", "-53000.1"),
    ]
    return " ".join(fields).ljust(191) + "\r\n"


def lola(index: int) -> str:
    longitude, latitude, surface = place(index, 1735e3)
    seen = (longitude + 0.02, latitude - 0.01, 1790e3)
    measured = np.linalg.norm(surface - cartesian(*seen)) - 0.545
    fields = ["0"] * 29
    fields[0] = utc(index)
    fields[1:5] = [
        f"{longitude:.7f}",
        f"{latitude:.7f}",
        f"{1735 + index / 1e3:.6f}",
        f"{measured / 1e3:.6f}",
    ]
    fields[15] = f"{et_from_utc(utc(index)):.9f}"
    fields[18:21] = [f"{seen[0]:.7f}", f"{seen[1]:.7f}", "1790.0"]
    return ",".join(field.rjust(13) for field in fields) + "\n"


def lola_binary() -> bytes:
    rows = np.zeros((4, 64), dtype="<u4")
    signed = rows.view("<i4")
    rows[:, 2], rows[:, 3] = 317845253 + np.arange(4), 2**31
    signed[:, 6], signed[:, 7] = 100 * 10**7, 60 * 10**7
    rows[:, 8], rows[:, 9] = 1790000000, 1737000000
    for first in range(10, 60, 10):
        signed[:, first], signed[:, first + 1] = 100 * 10**7, 60 * 10**7
        signed[:, first + 2], rows[:, first + 3] = 1735000000, 55000000 - 545
    return rows.tobytes()


def track(index: int) -> str:
    values = [*place(index, 250.0)[2] / 1e3, 0.7, 0.25 + index / 1e3, -0.13]
    return " ".join([utc(index), *(repr(float(value)) for value in values)]) + "\n"


def rows(build: Callable[[int], str], header: str = "") -> Callable[[], bytes]:
    """Return a function that makes the text of a table."""
    return (header + "".join(map(build, range(COUNT)))).encode
