"""Whether single scans fit the shape better elsewhere, each at a place of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fusion.scaling.fit.observation import Trajectory
from fusion.scaling.geometry.placing import KnownPlace
from fusion.scaling.places.places import FALSE_ALARM, PlaceCheck, check_place
from lidar.scans import Scan, join
from spcola.arrays import FloatArray
from spcola.shape import RayCaster

# Shots that a group of scans has at least: with fewer only large turns show.
_FEWEST = 60
# Groups that are compared at most, and shots of all of them: a matter of time.
_GROUPS, _SHOTS = 24, 1200


@dataclass(frozen=True, eq=False)
class ScanPlaces:
    """How each scan fits where it claims to be, and elsewhere.

    Attributes
    ----------
    names : tuple of tuple of str
        Scans of each group: one, or several that follow each other and have few shots.
    checks : tuple of PlaceCheck
        Of each group.
    """

    names: tuple[tuple[str, ...], ...] = ()
    checks: tuple[PlaceCheck, ...] = ()

    @property
    def misfits(self) -> tuple[bool, ...]:
        """Which groups fit better elsewhere, by more than chance in all groups together.

        The bound for all groups is that of the test of paired variances; the noise of the
        residuals' spectrum is asked for each group alone.
        """
        limit = FALSE_ALARM / max(len(self.checks), 1)
        return tuple(check.misfit and check.paired < limit for check in self.checks)


def check_scans(
    scans: Sequence[Scan],
    caster: RayCaster,
    *,
    prior: FloatArray,
    known: KnownPlace,
    trajectory: Trajectory = "reference",
) -> ScanPlaces:
    """Compare the fit of each scan where it claims to be with that elsewhere.

    Scans that are turned each about an axis of its own fit better at no place in common
    (:func:`fusion.scaling.places.check_place` looks for that one).

    Parameters
    ----------
    scans : sequence of Scan
        With spacecraft positions and beams, in the frame of the shape, in the order in which they
        were taken.
    caster, prior, known, trajectory
        As :func:`fusion.scaling.places.check_place` has them.

    Returns
    -------
    ScanPlaces
        Of nothing where there are no two groups of 60 shots.
    """
    groups = _grouped(scans)
    if len(groups) < 2:
        return ScanPlaces()
    sample = max(_FEWEST, _SHOTS // len(groups))
    checks = [
        check_place(
            join("group", group),
            caster,
            prior=prior,
            known=known,
            trajectory=trajectory,
            sample=sample,
        )
        for group in groups
    ]
    names = tuple(tuple(scan.name for scan in group) for group in groups)
    return ScanPlaces(names, tuple(checks))


def _grouped(scans: Sequence[Scan]) -> list[list[Scan]]:
    """Scans that follow each other, put together until they have enough shots."""
    least = max(_FEWEST, -(-sum(map(len, scans)) // _GROUPS))
    groups: list[list[Scan]] = []
    count = least
    for scan in filter(len, scans):
        if count >= least:
            groups.append([])
            count = 0
        groups[-1].append(scan)
        count += len(scan)
    # What is left over belongs to the last that has enough.
    if len(groups) > 1 and count < least:
        groups[-2:] = [groups[-2] + groups[-1]]
    return groups
