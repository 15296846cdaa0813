"""Single shots of all scans, geolocated by the settings, and counts of those without a place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion.estimation.verdict import Code, Finding, Severity
from fusion.scene.geolocation.kernels import coverage_text, span_text, utc_texts
from fusion.scene.geolocation.locating import Geolocator
from lidar.formats.native import iter_scan, scan_summary
from lidar.geolocation import KernelPlace, Unlocated
from lidar.scans import Scan, join

KEYS: Mapping[str, str] = {
    Unlocated.OUTSIDE_KERNELS: "outside_kernels",
    Unlocated.OUTSIDE_TRAJECTORY: "outside_trajectory",
    Unlocated.NO_TIME: "no_time",
}
"""Reason why shots have no place → its key in JSON."""


@dataclass(frozen=True, eq=False)
class LocatedShots:
    """Shots that were geolocated.

    Attributes
    ----------
    scans : tuple of Scan
        Those that have a place.
    count : int
        Number of shots read.
    lost : mapping of str to int
        Number of shots without a place, for each reason in :data:`KEYS`.
    span : (float, float)
        First and last time of all shots, s; NaN if unknown.
    within_m : float
        Error of places by interpolation, metres.
    place : KernelPlace, optional
        Geolocation by the kernels, if they were used.
    """

    scans: tuple[Scan, ...]
    count: int
    lost: Mapping[str, int]
    span: tuple[float, float]
    within_m: float
    place: KernelPlace | None

    @property
    def outside(self) -> int:
        """Shots at times that the kernels do not cover."""
        return self.lost.get(Unlocated.OUTSIDE_KERNELS, 0)

    def moved(self, scans: tuple[Scan, ...], within_m: float) -> LocatedShots:
        """Return the shots geolocated by another trajectory; those left out are outside it.

        Parameters
        ----------
        scans : tuple of Scan
            The shots with a place.
        within_m : float
            Error of their places by interpolation, metres.
        """
        fewer = sum(map(len, self.scans)) - sum(map(len, scans))
        lost = {
            **self.lost,
            Unlocated.OUTSIDE_TRAJECTORY: self.lost.get(Unlocated.OUTSIDE_TRAJECTORY, 0) + fewer,
        }
        return replace(self, scans=scans, lost=lost, within_m=max(self.within_m, within_m))

    def as_json(self) -> dict[str, Any]:
        """Return the entries of ``scale.json``: counts that add up, and the spans in UTC."""
        content: dict[str, Any] = {"n_shots": self.count}
        content |= {key: self.lost.get(reason, 0) for reason, key in KEYS.items()}
        if self.place is not None:
            windows = self.place.coverage.windows()
            content["spans"] = {
                "kernels_utc": utc_texts(windows[0, 0], windows[-1, 1]) if len(windows) else None,
                "kernels_windows": len(windows),
                "shots_utc": utc_texts(*self.span) if np.isfinite(self.span).all() else None,
            }
        return content

    def findings(self) -> tuple[Finding, ...]:
        """Return a finding if shots lie outside the kernels: a note if some lie inside."""
        if not self.outside:
            return ()
        severity = Severity.NOTE if any(map(len, self.scans)) else Severity.REFUSED
        value = float(self.outside)
        return (Finding(Code.OUTSIDE_KERNELS, severity, self.outside_text(), value, 0.0),)

    def outside_text(self) -> str:
        """Return one clause: how many shots lie outside the kernels, and the spans of both."""
        text = f"{self.outside} of {self.count} shots are outside the kernels"
        if self.place is None:
            return text
        return f"{text}: {coverage_text(self.place)}; the shots are of {span_text(*self.span)}"

    def unplaced(self, missed: int, located: str) -> str:
        """Return the main reason why there is nothing to compare, and what to do.

        Parameters
        ----------
        missed : int
            Shots that do not meet the shape.
        located : {"spc", "reference"}
            The trajectory that geolocates them.
        """
        of_all = f"of {self.count} shots"
        left_out, timeless = (
            self.lost.get(Unlocated.OUTSIDE_TRAJECTORY, 0),
            self.lost.get(Unlocated.NO_TIME, 0),
        )
        outside = (
            "lie outside the states of the images, or between two further apart than [scale] "
            "max_gap_s; use shots taken with the images"
            if located == "spc"
            else "have no spacecraft position, so that they cannot be moved; import them with one"
        )
        reasons = [
            (
                missed,
                f"{missed} {of_all} do not meet the shape, or have no spacecraft position; check "
                "that shots and shape have the same frame and unit",
            ),
            (
                self.outside,
                f"{self.outside_text()}; give kernels of the shots' times, or widen max_gap_s",
            ),
            (left_out, f"{left_out} {of_all} {outside}"),
            (timeless, f"{timeless} {of_all} have no time; import them with one"),
        ]
        return max(reasons, key=lambda reason: reason[0])[1]


def located_shots(paths: Sequence[Path], locator: Geolocator, most: int) -> LocatedShots:
    """Read and geolocate the shots of each scan, evenly thinned.

    Parameters
    ----------
    paths : sequence of Path
        Of the scans.
    locator : Geolocator
    most : int
        About the number of shots in all.
    """
    total = sum(scan_summary(path).count for path in paths)
    step = max(1, -(-total // most))
    scans, count, within = [], 0, 0.0
    lost: dict[str, int] = {}
    span = (np.inf, -np.inf)
    for path in paths:
        parts = [part.select(np.arange(0, len(part), step)) for part in iter_scan(path)]
        read = join(path.stem, parts)
        count += len(read)
        known = read.time[np.isfinite(read.time)]
        if len(known):
            span = (min(span[0], known.min()), max(span[1], known.max()))
        scan, error = locator.located(read)
        for reason in KEYS:
            fewer = scan.rejected.get(reason, 0) - read.rejected.get(reason, 0)
            lost[reason] = lost.get(reason, 0) + fewer
        within = max(within, error)
        scans.append(scan)
    first, last = (float(end) for end in span)
    known_span = (first, last) if first <= last else (np.nan, np.nan)
    return LocatedShots(tuple(scans), count, lost, known_span, within, locator.place)
