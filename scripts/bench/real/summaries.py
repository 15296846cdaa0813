"""Lines about states, photometric functions and maplets of a real body."""

from __future__ import annotations

from typing import Any

import numpy as np

from fusion.workspace import Workspace
from spcola.grids import Maplet

# Outcomes that keep the start.
UNSOLVED = ("too-few-images", "diverged")


def print_states(found: dict[str, Any]) -> None:
    """Print how the states of images were fitted to the shape."""
    pixel, line = found["moved_rms_px"]
    sigma = np.median([np.mean(one["sigma_px"]) for one in found["images"].values()
                       if one["sigma_px"]])  # fmt: skip
    print(
        f"  states: {found['outcomes']}; moved {pixel:.2f}, {line:.2f} px rms (sigma {sigma:.2f}); "
        f"correlation {found['correlation_start']:.3f} → {found['correlation']:.3f}; ranges × "
        f"{found['range_ratio']:.4f} ± {found['range_ratio_scatter']:.4f}"
    )


def print_photometry(found: dict[str, Any]) -> str:
    """Print how photometric functions fit; return the setting of the best."""
    (one,) = found["filters"]
    functions = {each["name"]: each for each in one["functions"]}
    for name, each in functions.items():
        print(f"    {name}: residual {each['residual_std']:.2%}, worse by {each['worse_by']:.1f} σ")
    setting = str(one["setting"])
    print(f"  photometric function: {setting}")
    return setting


def print_outcomes(found: dict[str, Any]) -> None:
    """Print how maplets were solved."""
    solved = [one for one in found["maplets"].values() if one["outcome"] not in UNSOLVED]
    print(f"  outcomes: {found['outcomes']}")
    if not solved:
        return
    directions = np.mean([one["directions"] for one in solved], axis=0)
    fits = [fit for one in solved for fit in one["images"].values() if fit["fit"] == "used"]
    shift = np.sqrt(np.mean([np.square(fit["shift_px"]) for fit in fits], axis=0))
    print(
        f"  residual of brightness {found['residual_start']:.1%} → {found['residual']:.1%}; "
        f"correlation {np.median([fit['correlation'] for fit in fits]):.3f}; shifts "
        f"{shift[0]:.2f}, {shift[1]:.2f} px rms; sigma of heights "
        f"{np.median([one['sigma_m'] for one in solved]):.2f} m; slopes determined in 0, 1, 2 "
        f"directions: {', '.join(f'{share:.0%}' for share in directions)}"
    )
    for one in found["findings"]:
        print(f"    {one['code']}: {len(one['names'])} ({', '.join(one['names'][:3])})")


def print_slopes_by_sun(after: Workspace, content: dict[str, Any]) -> None:
    """Print rms slopes along the Sun and across it: one Sun determines the first alone."""
    sun = np.mean([image.sun for image in after.images()], axis=0)
    found = []
    for name, one in content["maplets"].items():
        if one["outcome"] in UNSOLVED:
            continue
        found.append(_slopes_along(after.maplet(name), sun))
    if found:
        along, across = np.sqrt(np.mean(np.square(found), axis=0))
        print(
            f"  rms slopes along the Sun {np.degrees(np.arctan(along)):.1f}°, across it "
            f"{np.degrees(np.arctan(across)):.1f}°, from a start without relief"
        )


def _slopes_along(maplet: Maplet, sun: np.ndarray) -> tuple[float, float]:
    way = (maplet.grid.axes @ sun)[:2]
    way /= np.linalg.norm(way)
    by_y, by_x = np.gradient(maplet.height, maplet.grid.gsd)
    along, across = way[0] * by_x + way[1] * by_y, way[0] * by_y - way[1] * by_x
    return float(np.nanstd(along)), float(np.nanstd(across))
