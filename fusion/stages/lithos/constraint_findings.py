"""Constraining heights that contradict the surface or each other, or constrain nothing."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from fusion.estimation.verdict import Code
from fusion.pipeline.solutions.lidar_content import LidarContent
from spcola.photometry.photoclinometry import Outcome

# Robust sigmas from the surface beyond which heights contradict it; share of them left out as false
# above which the others are doubtful; fewest heights that are judged.
_CONTRADICTS, _FALSE, _FEWEST = 3.0, 0.2, 20
# What the heights of other maplets of the solution are called together.
_MAPLETS = "overlapping maplets"


def constraint_findings(
    maplets: Mapping[str, Mapping[str, Any]], given: Iterable[str]
) -> Iterator[dict[str, Any]]:
    """Yield what is wrong with constraining heights by code: `code`, `names` (maplets), `do`.

    Parameters
    ----------
    maplets : mapping of str to mapping
        `outcome` and `constraints` of each, as ``photoclinometry.json`` has them.
    given : iterable of str
        Names of the constraints that do not come from other maplets or the shape.
    """
    far, false = defaultdict[str, list[str]](list), defaultdict[str, list[str]](list)
    used, known = set[str](), {"shape", *given}
    for name, content in maplets.items():
        for constraint, fit in content["constraints"].items():
            kind = constraint if constraint in known else _MAPLETS
            every = fit["heights"] + fit["left_out"]
            if fit["heights"]:
                used.add(constraint)
            if every >= _FEWEST and fit["left_out"] > _FALSE * every:
                false[kind].append(name)
            judged = content["outcome"] != Outcome.TOO_FEW_IMAGES and fit["heights"] >= _FEWEST
            if judged and fit["ratio"] is not None and fit["ratio"] > _CONTRADICTS:
                far[kind].append(name)
    for kind, names in false.items():
        yield {
            "code": "heights-left-out",
            "names": list(dict.fromkeys(names)),
            "do": f"more than {_FALSE:.0%} of their heights of {kind} contradict the others and "
            "were left out: look at the scans there, their times and units: spcola look",
        }
    for kind, names in far.items():
        yield {
            "code": "constraint-contradicts",
            "names": list(dict.fromkeys(names)),
            "do": f"their heights lie more than {_CONTRADICTS:g} sigmas from those of {kind}, "
            f"which images or other constraints contradict: {_what_to_do(kind)}",
        }
    if unused := [name for name in given if maplets and name not in used]:
        yield {
            "code": "constraint-unused",
            "names": unused,
            "do": "no maplet has heights of them: check their frame, units and place, and whether "
            "the maplets that were asked for lie there",
        }


def counted_twice(content: LidarContent, names: Iterable[str]) -> dict[str, Any]:
    """Return a finding: maplets were solved with the lidar, and with maplets that contain it.

    Parameters
    ----------
    content : LidarContent
        Of the maplets of the parent.
    names : iterable of str
        Of the maplets that were solved.
    """
    other = f"the solution {content.without}" if content.without else "one without it"
    do = f"{content.text}: sigmas are too small; start from {other}"
    return {"code": str(Code.LIDAR_COUNTED_TWICE), "names": list(names), "do": do}


def _what_to_do(kind: str) -> str:
    """Return what to do about heights that contradict the others."""
    if kind in ("lidar", "returns"):
        return "check the registration: spcola register"
    if kind == "shape":
        return "state how good the shape is: --shape-sigma"
    if kind == "limbs":
        return "fit the states: spcola spc register; or leave limbs out of the constraints"
    if kind == _MAPLETS:
        return "solve these too, or leave them out: --constraint"
    return "check its frame and units, or state a larger sigma: --map-sigma"
