"""Wrong single shots: named alterations of a scan.

Each alters spacecraft and returns of a correct scan together, as an error of a frame, a unit or a
file would. `alterations()` returns them in their order; `altered(scan, name)` applies one.
``spcola scale`` must accept none of the results.

    for name, alter in alterations().items():
        write_scan(folder / f"{name}.h5", [alter(scan)])

Rotations in latitude are about an axis of each scan: several scans altered one by one are not
rotated as a whole, so that no common rotation corrects them. For a scan of another body, use the
scan of one body and the shape of another.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from lidar.scans import Scan
from spcola.arrays import FloatArray

Alteration = Callable[[Scan], Scan]


def alterations(seed: int = 0) -> Mapping[str, Alteration]:
    """Return the alterations by their names; `seed` is that of their random numbers."""
    turns = {
        f"longitude {turn:+g} deg": _mapped(_about([0, 0, 1], turn))
        for turn in (5.0, -5.0, 10.0, -10.0, 30.0, 90.0, 180.0)
    }
    return turns | {
        "latitude +5 deg": northward(5.0),
        "latitude -10 deg": northward(-10.0),
        "sign of longitude": _mapped(np.diag([1.0, -1.0, 1.0])),
        "mirrored north-south": _mapped(np.diag([1.0, 1.0, -1.0])),
        "mirrored through the centre": _mapped(-np.eye(3)),
        "axes x and y exchanged": _mapped(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])),
        "axes rotated, z for x": _mapped(np.roll(np.eye(3), 1, axis=0)),
        "kilometres as metres": _mapped(1e-3 * np.eye(3)),
        "metres as kilometres": _mapped(1e3 * np.eye(3)),
        "feet as metres": _mapped(np.eye(3) / 0.3048),
        "spacecraft in kilometres": spacecraft_in_kilometres,
        "ranges exchanged": lambda scan: ranges_exchanged(scan, seed),
        "a random cloud": lambda scan: random_cloud(scan, seed),
    }


def altered(scan: Scan, name: str, seed: int = 0) -> Scan:
    """Return `scan` with the alteration `name`.

    Raises
    ------
    KeyError
        If there is no such alteration.
    """
    return alterations(seed)[name](scan)


def moved(scan: Scan, points: FloatArray, spacecraft: FloatArray) -> Scan:
    """Return `scan` with other points and spacecraft positions (N, 3), metres."""
    return Scan.of_points(
        scan.name, points, time=scan.time, spacecraft=spacecraft, sigma=scan.sigma, flag=scan.flag
    )


def northward(turn_deg: float) -> Alteration:
    """Return a rotation of a scan to the north, in the meridian of its mean direction."""

    def alter(scan: Scan) -> Scan:
        east = np.cross([0.0, 0.0, 1.0], scan.points.mean(axis=0))
        size = float(np.linalg.norm(east))
        axis = -east / size if size > 0 else np.array([1.0, 0.0, 0.0])
        return _mapped(_about(axis, turn_deg))(scan)

    return alter


def spacecraft_in_kilometres(scan: Scan) -> Scan:
    """Return the scan with positions of the spacecraft in kilometres instead of metres."""
    return moved(scan, scan.points, 1e-3 * scan.spacecraft)


def ranges_exchanged(scan: Scan, seed: int) -> Scan:
    """Return the scan with ranges exchanged between beams: its relief exists nowhere."""
    order = np.random.default_rng(seed).permutation(len(scan))
    distance = np.linalg.norm(scan.points - scan.spacecraft, axis=1)
    return moved(scan, scan.spacecraft + distance[order, None] * scan.beam, scan.spacecraft)


def random_cloud(scan: Scan, seed: int) -> Scan:
    """Return the scan with random directions around the body and the radii of its returns."""
    generator = np.random.default_rng(seed)
    radius = generator.permutation(np.linalg.norm(scan.points, axis=1))
    away = generator.normal(size=scan.points.shape)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    height = np.linalg.norm(scan.spacecraft, axis=1, keepdims=True)
    return moved(scan, radius[:, None] * away, height * away)


def _mapped(matrix: FloatArray) -> Alteration:
    """Map points and spacecraft by a matrix (3, 3)."""
    return lambda scan: moved(scan, scan.points @ matrix.T, scan.spacecraft @ matrix.T)


def _about(axis: FloatArray | list[float], turn_deg: float) -> FloatArray:
    """Rotation matrix (3, 3) about `axis`."""
    matrix: FloatArray = Rotation.from_rotvec(np.radians(turn_deg) * np.asarray(axis)).as_matrix()
    return matrix
