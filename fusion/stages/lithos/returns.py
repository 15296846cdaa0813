"""Registered returns of the lidar as constraining heights, each at the place of its footprint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fusion.registration.results import GivenRegistration, given_registration
from fusion.scene.geolocation import ReturnSource
from fusion.stages.lithos.options import ConstraintKind
from fusion.workspace import Workspace
from lidar.adjustment import displacement_partials
from lidar.scans import Returns
from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.grids import Maplet, MapletGrid
from spcola.grids.gaps import filled
from spcola.math.robust import mad
from spcola.photometry.photoclinometry import HeightConstraint

# A return of which fewer than `_SUPPORT` of the `_NEIGHBOURS` nearest ones agree within `_FAR`
# sigmas is false. In a gap false ones are each other's nearest, and some agree: only groups of at
# least `_GROUP` returns, each with the agreement of half of its nearest ones, are the ground, and
# others have to agree with the nearest return of it.
_NEIGHBOURS, _SUPPORT, _FAR, _GROUP = 12, 2, 5.0, 12
# Share of the returns, those nearest to another one, whose differences are noise; fewest of them.
_CLOSE, _FEWEST = 0.1, 20
# Smallest error that all heights share, and smallest noise, metres.
_LEAST_COMMON, _LEAST_NOISE = 1e-5, 1e-4


def lidar_kind(workspace: Workspace) -> ConstraintKind:
    """Return as what the lidar of a workspace constrains best: returns, or mapolas without scans.

    A return has its own place; a cell of a mapola is a median over ground that bends.

    Parameters
    ----------
    workspace : Workspace
    """
    return ConstraintKind.RETURNS if workspace.scan_paths() else ConstraintKind.LIDAR


@dataclass(frozen=True, eq=False)
class RegisteredReturns:
    """The returns of a workspace, adjusted and registered.

    Parameters
    ----------
    source : ReturnSource
        Geolocated and adjusted as for mapolas.
    registration : GivenRegistration
        Of the workspace.
    scan_sigma_m : float
        Error that the returns of a scan share, each axis, metres, where scans were not adjusted.
    """

    source: ReturnSource
    registration: GivenRegistration
    scan_sigma_m: float

    @classmethod
    def of(cls, workspace: Workspace) -> RegisteredReturns:
        """Open them.

        Raises
        ------
        WorkspaceError
            If the workspace is not registered.
        InvalidValueError
            If its registration was refused or is not valid.
        """
        path = workspace.registration_path
        given = given_registration(workspace.read_json(path.name), str(path))
        sigma = workspace.settings().registration.scan_sigma_m
        return cls(ReturnSource.of_workspace(workspace), given, sigma)

    def constraint(self, start: Maplet, slope_sigma: float) -> HeightConstraint:
        """Return the heights of the returns on the grid of a maplet, without false ones.

        Parameters
        ----------
        start : Maplet
            Heights known so far.
        slope_sigma : float
            Of the slopes of these.
        """
        grid = start.grid
        there = grid.moved(self.registration.known.transform.inverse())
        returns = self.source.around(there, self._reach(there)).of_own_scans()
        places = self._registered(returns, grid)
        half = grid.half_size * grid.gsd
        within = np.all(np.abs(places) <= [half, half, self.source.options.reach(grid)], axis=1)
        returns, places = returns.select(within).of_own_scans(), places[within]
        apart = above(start, places)
        found = noise_of_pairs(places, apart, self.source.options.default_sigma_m)
        sigma = np.where(np.isfinite(returns.sigma), returns.sigma, found)
        true = supported(places, sigma, apart, slope_sigma, grid)
        returns = returns.select(true).of_own_scans()
        shared = self._covariance(returns.scan_names, there)
        constraint = HeightConstraint.of_points(
            "returns", grid, places[true], sigma[true], returns.scan, shared
        )
        return replace(constraint, left_out=int(np.sum(~true)))

    def _registered(self, returns: Returns, grid: MapletGrid) -> FloatArray:
        """Return where returns (N, 3) lie on a grid after their registration: x, y, height (m)."""
        none = np.zeros((3, 3))
        rows = np.array(
            [self.registration.scans.get(name, none) for name in returns.scan_names]
        ).reshape(-1, 3, 3)[returns.scan]
        shift = rows[:, 1] + np.cross(rows[:, 2], returns.points - rows[:, 0])
        points = self.registration.known.transform.apply(returns.points) + shift
        local: FloatArray = (points - grid.center) @ grid.axes.T
        return local

    def _reach(self, grid: MapletGrid) -> float:
        """Return the largest displacement of returns on a grid by the registration of scans (m)."""
        moved = [
            float(np.linalg.norm(offset))
            + float(np.linalg.norm(turn) * (np.linalg.norm(grid.center - center) + grid.radius))
            for center, offset, turn in self.registration.scans.values()
        ]
        return max(moved, default=0.0)

    def _covariance(self, scans: tuple[str, ...], grid: MapletGrid) -> FloatArray:
        """Return the covariance (S, S), m², of the heights of scans on a grid, lidar coordinates.

        What is common to them is the error of the nearest mapola's registered position; how they
        differ is what their adjustment leaves.
        """
        count = len(scans)
        apart = np.eye(count) - 1.0 / max(count, 1)
        common = grid.uz @ self._position_covariance(grid) @ grid.uz + _LEAST_COMMON**2
        own = apart @ self._scan_covariance(scans, grid) @ apart
        return 0.5 * (own + own.T) + common + _LEAST_COMMON**2 * np.eye(count)

    def _scan_covariance(self, scans: tuple[str, ...], grid: MapletGrid) -> FloatArray:
        """Return the covariance (S, S), m², of the heights of scans that their adjustment leaves.

        One that was not adjusted has an independent error.
        """
        adjustment = self.source.adjustment
        count = len(scans)
        unknown = self.scan_sigma_m**2 * np.eye(count)
        if adjustment is None:
            return unknown
        number = {name: k for k, name in enumerate(adjustment.names)}
        known = np.array([name in number for name in scans], dtype=np.bool_)
        chosen = np.array([number[name] for name in scans if name in number], dtype=np.intp)
        rows = grid.uz @ displacement_partials(grid.center, adjustment.center[chosen])
        columns = (6 * chosen[:, None] + np.arange(6)).ravel()
        joint = adjustment.covariance[np.ix_(columns, columns)]
        size = len(chosen)
        blocks = joint.reshape(size, 6, size, 6)
        unknown[np.ix_(known, known)] = np.einsum("ia,iajb,jb->ij", rows, blocks, rows)
        return unknown

    def _position_covariance(self, grid: MapletGrid) -> FloatArray:
        """Return the covariance (3, 3), m², of the nearest mapola, or of the transform alone."""
        registration = self.registration
        near = min(
            registration.covariances.values(),
            key=lambda one: float(np.linalg.norm(one[0] - grid.center)),
            default=None,
        )
        if near is None:
            found: FloatArray = registration.known.position_covariance(grid.center[None])[0]
            return found
        return near[1]


def noise_of_pairs(places: FloatArray, apart: FloatArray, default: float) -> float:
    """Return the standard deviation of single returns, metres, from the closest pairs of them.

    Relief hardly differs within such a pair. It is not that of the ranges alone: what a cell has of
    relief finer than itself is in it.

    Parameters
    ----------
    places : (N, 3) ndarray
        On the grid, metres.
    apart : (N,) ndarray
        Their heights above a known surface, metres.
    default : float
        With too few returns, metres.
    """
    if len(places) < 2 * _FEWEST:
        return default
    distance, other = _nearest(places, 2)
    close = np.argsort(distance[:, 1], kind="stable")[: max(_FEWEST, int(_CLOSE * len(places)))]
    partner = np.where(other[close, 0] == close, other[close, 1], other[close, 0])
    noise = float(mad(apart[close] - apart[partner])) / np.sqrt(2.0)
    return float(np.clip(noise, _LEAST_NOISE, default))


def supported(
    places: FloatArray, sigma: FloatArray, apart: FloatArray, slope_sigma: float, grid: MapletGrid
) -> BoolArray:
    """Return which returns (N,) agree with at least two of the nearest ones and with the ground.

    The ground are large groups of returns with which at least half of their nearest ones agree. In
    a gap of the lidar the nearest ones of a false return are other false ones, and some agree by
    chance.

    Parameters
    ----------
    places : (N, 3) ndarray
        On the grid, metres.
    sigma : (N,) ndarray
        Metres.
    apart : (N,) ndarray
        Their heights above a known surface, metres.
    slope_sigma : float
        Of the slopes of that surface.
    grid : MapletGrid
    """
    count = min(_NEIGHBOURS, len(places) - 1)
    if count < _SUPPORT:
        return np.zeros(len(places), dtype=np.bool_)
    every = np.arange(len(places))

    def agree(distance: FloatArray, one: IntArray, other: IntArray) -> BoolArray:
        # Errors of slopes from cell to cell are independent.
        relief = slope_sigma * np.sqrt(grid.gsd * np.maximum(distance, grid.gsd))
        allowed = _FAR * np.sqrt(sigma[one] ** 2 + sigma[other] ** 2 + relief**2)
        near: BoolArray = np.abs(apart[one] - apart[other]) <= allowed
        return near

    distance, other = _nearest(places, count + 1)
    # A place may be that of several returns, so that the first is not always the return itself.
    own = other == every[:, None]
    own[~own.any(axis=1), -1] = True
    linked = agree(distance, every[:, None], other) & ~own
    support = np.sum(linked, axis=1)
    enough: BoolArray = support >= _SUPPORT
    majority: BoolArray = 2 * support >= count
    if not majority.any():
        return majority
    ground = majority & _in_large_groups(linked & majority[:, None] & majority[other], other)
    alone = np.flatnonzero(enough & ~ground)
    away, place = cKDTree(places[ground, :2]).query(places[alone, :2])
    enough[alone] = agree(np.asarray(away), alone, np.flatnonzero(ground)[place])
    return enough


def _in_large_groups(linked: BoolArray, other: IntArray) -> BoolArray:
    """Return which returns (N,) are in a group of at least `_GROUP`, or else in the largest.

    `linked` (N, K) are agreements with the returns `other` (N, K); a group is connected by them.
    """
    size = len(linked)
    rows, columns = np.nonzero(linked)
    links = csr_array((np.ones(len(rows)), (rows, other[rows, columns])), (size, size))
    group = connected_components(links, directed=False)[1]
    members = np.bincount(group)[group]
    large: BoolArray = members >= min(_GROUP, int(members.max()))
    return large


def _nearest(places: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """Return distances and numbers (N, count) of the nearest places, itself among them."""
    distance, other = cKDTree(places[:, :2]).query(places[:, :2], np.arange(1, count + 1))
    return np.asarray(distance), np.asarray(other)


def above(start: Maplet, places: FloatArray) -> FloatArray:
    """Return the heights (N,) of places above a maplet, metres.

    Parameters
    ----------
    start : Maplet
        NaN heights are interpolated.
    places : (N, 3) ndarray
        On its grid, metres.
    """
    x, y = places[:, :2].T / start.grid.gsd
    return places[:, 2] - start.grid.interpolated(filled(start.height), x, y)
