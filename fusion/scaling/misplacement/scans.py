"""Test whether single scans fit the shape better elsewhere, each at a place of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

from fusion.scaling.fit.observation import TrajectorySource
from fusion.scaling.geometry.placement import LidarPlacement
from fusion.scaling.misplacement.check import FALSE_ALARM, PlaceCheck, check_place
from lidar.scans import Scan, join
from spcola.arrays import FloatArray
from spcola.shape import RayCaster

# Fewest shots in a group of scans: with fewer only large rotations are detected.
_FEWEST = 60
# Largest numbers of groups and of all their shots, which limit the run time.
_GROUPS, _SHOTS = 24, 1200


@dataclass(frozen=True, eq=False)
class ScanChecks:
    """Fit of each scan at its stated position, and elsewhere.

    Attributes
    ----------
    names : tuple of tuple of str
        Scans of each group: one, or several consecutive ones with few shots.
    checks : tuple of PlaceCheck
        Of each group.
    """

    names: tuple[tuple[str, ...], ...] = ()
    checks: tuple[PlaceCheck, ...] = ()

    @property
    def misfits(self) -> tuple[bool, ...]:
        """For each group, whether it fits better elsewhere, significantly over all groups.

        Bonferroni's bound over groups is applied to the test of paired variances; the test with
        noise of the residuals' spectrum is for each group alone.
        """
        limit = FALSE_ALARM / max(len(self.checks), 1)
        return tuple(check.misfit and check.paired < limit for check in self.checks)


def check_scans(
    scans: Sequence[Scan],
    caster: RayCaster,
    *,
    prior: FloatArray,
    known: LidarPlacement,
    trajectory: TrajectorySource = "reference",
    each: Callable[[Callable[[Scan], PlaceCheck], list[Scan]], Iterable[PlaceCheck]] = map,
) -> ScanChecks:
    """Compare the fit of each scan at its stated position with that elsewhere.

    Scans that are rotated about different axes have no common better place, which
    :func:`fusion.scaling.misplacement.check_place` searches for.

    Parameters
    ----------
    scans : sequence of Scan
        With spacecraft positions and beams, in the frame of the shape, in order of time.
    caster, prior, known, trajectory
        As in :func:`fusion.scaling.misplacement.check_place`.
    each : callable, optional
        Applies a function to each group of scans, as the built-in ``map``; others do it in
        parallel, or show progress.

    Returns
    -------
    ScanChecks
        Empty if there are fewer than two groups of 60 shots.
    """
    groups = _grouped(scans)
    if len(groups) < 2:
        return ScanChecks()
    check = partial(
        check_place,
        caster=caster,
        prior=prior,
        known=known,
        trajectory=trajectory,
        sample=max(_FEWEST, _SHOTS // len(groups)),
    )
    names = tuple(tuple(scan.name for scan in group) for group in groups)
    return ScanChecks(names, tuple(each(check, [join("group", group) for group in groups])))


def _grouped(scans: Sequence[Scan]) -> list[list[Scan]]:
    """Groups of consecutive scans with enough shots each."""
    least = max(_FEWEST, -(-sum(map(len, scans)) // _GROUPS))
    groups: list[list[Scan]] = []
    count = least
    for scan in filter(len, scans):
        if count >= least:
            groups.append([])
            count = 0
        groups[-1].append(scan)
        count += len(scan)
    # A last group with too few shots joins the one before.
    if len(groups) > 1 and count < least:
        groups[-2:] = [groups[-2] + groups[-1]]
    return groups
