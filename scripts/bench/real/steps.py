"""What is printed of each step of a mission: states, maplets, photometry, outcomes."""

from __future__ import annotations

from typing import Any

import numpy as np

# Outcomes that keep the start.
UNSOLVED = ("too-few-images", "diverged")


def print_states(found: dict[str, Any]) -> None:
    """Print how far states moved when they were fitted to the shape."""
    pixel, line = found["moved_rms_px"]
    sigma = np.median([np.mean(one["sigma_px"]) for one in found["images"].values()
                       if one["sigma_px"]])  # fmt: skip
    print(
        f"  states: {found['outcomes']}; moved {pixel:.2f}, {line:.2f} px rms (sigma {sigma:.2f}); "
        f"correlation {found['correlation_start']:.3f} → {found['correlation']:.3f}; ranges × "
        f"{found['range_ratio']:.4f} ± {found['range_ratio_scatter']:.4f}"
    )


def print_tiles(found: dict[str, Any]) -> None:
    """Print how many maplets were tiled."""
    print(f"  {found['maplets']} maplets, {found['without_pictures']} without images")


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
    """Print how the maplets ended and how well images fit them."""
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
