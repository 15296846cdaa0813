"""The verdict on the registration of a workspace, and the evidence from its surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from fusion.estimation.verdict import Cause, Code, Finding, Severity, Verdict
from fusion.pipeline import StageContext
from fusion.registration.judging import Evidence, ReliefPair, common_relief
from fusion.registration.results import GivenRegistration, mapola_registrations, transform_of
from fusion.scene import surface_reference
from fusion.stages.register.frame_search import search_workspace_frames
from fusion.stages.register.matching import Matched, Matcher
from fusion.surfacematch import Match, Surface
from fusion.surfacematch.resolution import blur
from fusion.workspace.settings.processing import RegisterSettings
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError, SpcolaError
from spcola.grids import MapletGrid
from spcola.math.robust import mad

# Most mapolas from which the evidence for the whole solution is taken.
_SAMPLE = 24
# Keys that a refused registration must not give to programs that ignore its verdict.
_TRANSFORM = (
    "scale",
    "scale_sigma",
    "rotation_deg",
    "rotation_sigma_deg",
    "translation_m",
    "translation_sigma_m",
    "covariance",
    "inverse",
)
_ESTIMATE = (*_TRANSFORM, "matrix", "strain", "strain_sigma")


def evidence_of(
    context: StageContext,
    matched: Matched,
    content: Mapping[str, Any] | None = None,
    given: GivenRegistration | None = None,
) -> Evidence:
    """Compare a sample of registered mapolas with the SPC surface.

    Parameters
    ----------
    context : StageContext
        Context of the registration stage.
    matched : Matched
        Matches on which the registration is based.
    content : mapping, optional
        ``registration.json``; without it the mapolas have no expected place.
    given : GivenRegistration, optional
        Transform from which the mapolas were searched, if not from their own place.
    """
    workspace, table = context.workspace, context.table(RegisterSettings)
    reference = surface_reference(workspace, table.against)
    matcher = Matcher(workspace, table, reference, given, None, context.items)
    shifts = _displacements(content) if content is not None else {}
    sample = matched.matches[:: -(-len(matched.matches) // _SAMPLE)]

    def compared(match: Match) -> tuple[ReliefPair, float]:
        mapola = workspace.mapola(match.name)
        grid = matcher.grid(mapola.grid)
        surface = reference(match.name, grid)
        lidar, spc = mapola.height, surface.height
        if matched.blur_cells > 0:
            lidar = blur(lidar, matched.blur_cells, of_slopes=surface.of_slopes)
        elif matched.blur_cells < 0:
            spc = blur(spc, -matched.blur_cells, of_slopes=surface.of_slopes)
        reach = max(1, int(np.ceil(table.capture_m / grid.gsd)))
        shift = _shift(shifts.get(match.name), grid)
        stated = _stated_sigma(mapola.sigma, surface)
        noise = stated if np.isfinite(stated) else 0.0
        return ReliefPair(lidar, spc, shift, reach, noise), float(mad(match.residual)) / stated

    found = context.map("project relief", compared, sample)
    pairs = [pair for pair, _ in found]
    relief = common_relief(pairs, partial(context.map, "compare relief"))
    return Evidence(relief, np.array([chi for _, chi in found]))


def _stated_sigma(sigma: FloatArray, surface: Surface) -> float:
    """Return the median sigma of mapola (`sigma`) minus SPC, metres; NaN if not stated."""
    known = np.isfinite(sigma) & np.isfinite(surface.height) & (surface.variance > 0)
    if not known.any():
        return float("nan")
    return float(np.median(np.sqrt(sigma[known] ** 2 + surface.variance[known])))


def other_frames(context: StageContext) -> tuple[dict[str, Any], tuple[Finding, ...]]:
    """Search for another frame in which the lidar fits: ``frame_search`` of the JSON, and a note.

    Nothing is found without returns in the workspace, or on a body without relief.
    """
    with context.progress.task("search for the frame", 1) as task:
        try:
            search = search_workspace_frames(context.workspace, context.settings)
        except SpcolaError as error:
            return {"found": False, "text": f"was not possible: {error}"}, ()
        finally:
            task.advance()
    best = search.best
    if best is None or not best.change.changes:
        return search.as_json(), ()
    return search.as_json(), (Finding(Code.FITS_OTHERWISE, Severity.NOTE, search.text),)


def with_verdict(content: Mapping[str, Any], verdict: Verdict) -> dict[str, Any]:
    """Return ``registration.json`` with its verdict.

    The estimate of a refused registration is under ``refused_estimate`` only, so that no program
    uses it as a transform.
    """
    judged = {**content, **verdict.as_json()}
    if verdict.judgement != "refused":
        return judged
    estimate = {key: judged[key] for key in _ESTIMATE if key in judged}
    return {**judged, **dict.fromkeys(estimate), "refused_estimate": estimate}


def unregistered(
    error: NotObservableError, matches: Sequence[Match], table: RegisterSettings
) -> tuple[dict[str, Any], Verdict]:
    """Return ``registration.json`` if no transform could be fitted, and its verdict."""
    usable = sum(match.usable for match in matches)
    code = Code.NOT_DETERMINED if usable else Code.NO_MATCH
    content: dict[str, Any] = {
        "by": table.by,
        "model": table.model,
        **dict.fromkeys(_TRANSFORM),
        "n_used": 0,
        "n_rejected": len(matches),
        "converged": False,
        "reason": error.what,
        "reasons": [error.what],
        "per_mapola": [
            {
                "name": match.name,
                "center_m": match.center,
                "used": False,
                "reason": match.reason or Cause.NO_TRANSFORM.meaning,
                "cause": match.cause or Cause.NO_TRANSFORM,
                "coverage": match.coverage,
                "correlation": match.correlation,
            }
            for match in matches
        ],
    }
    text = error.what if error.do is None else f"{error.what}; {error.do}"
    return content, Verdict((Finding(code, Severity.REFUSED, text),))


def _displacements(content: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Return the registered centres of the mapolas (3,), SPC coordinates, metres."""
    transform = transform_of(content, "registration")
    shifts = mapola_registrations(content, "registration")
    return {
        str(entry["name"]): transform.apply(np.array(entry["center_m"], dtype=np.float64))
        + shifts[str(entry["name"])].shift
        for entry in content["per_mapola"]
    }


def _shift(target: FloatArray | None, searched: MapletGrid) -> FloatArray:
    """Return the displacement (2,) of a `target` (3,) from the `searched` grid, in its cells."""
    if target is None:
        return np.full(2, np.nan)
    along: FloatArray = (searched.axes @ (target - searched.center))[:2] / searched.gsd
    return along
