"""What the tests of the page's views share: a workspace worth looking at, and axe."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from ball import RADIUS, ball_workspace

import fusion.service.page
from fusion.workspace import Workspace
from spcola.formats.maplets import read_maplet, write_maplet
from spcola.formats.shapes import write_obj_mesh
from spcola.shape.icq import IcqShape, icq_directions

_AXE = Path(fusion.service.page.__file__).parent / "node_modules/axe-core/axe.min.js"
_COLOURS = ["color-contrast", "link-in-text-block"]
GAP = (slice(0, 6), slice(0, 6))
"""Nodes of the maplet AA0001 that are unknown: the upper left of its image."""


def worth_a_look(root: Path) -> Workspace:
    """Make a ball with a shape, residuals of a registration, epsilon, and a gap in a maplet."""
    made = ball_workspace(root)
    mesh = IcqShape(RADIUS * icq_directions(24)).mesh()
    write_obj_mesh(made.root / "SHAPEFILES" / "ball.obj", mesh)
    path = made.maplet_path("AA0001")
    maplet = read_maplet(path)
    height, albedo = np.array(maplet.height), np.array(maplet.albedo)
    height[GAP] = np.nan
    write_maplet(path, type(maplet)(maplet.name, maplet.grid, height, albedo))
    made.write_json("registration.json", _registration())
    made.write_json("scale.json", _scale())
    return made


def ready(page: Any, address: str) -> Any:
    """Open a view, and wait until it is drawn."""
    page.goto("about:blank")
    page.goto(f"/#{address}")
    page.wait_for_selector("[data-ready]", state="attached")
    return page


def serious(page: Any) -> list[tuple[str, str, list[str]]]:
    """Return what axe finds serious or critical in the light and in the dark, with the elements.

    The two differ in colours alone: the other rules are checked once.
    """
    found = []
    page.evaluate(_AXE.read_text(encoding="utf-8"))
    for scheme, rules in (("light", {}), ("dark", {"runOnly": _COLOURS})):
        page.emulate_media(color_scheme=scheme)
        # What passes is not to be described node by node.
        options = {"resultTypes": ["violations"], **rules}
        found += [
            (scheme, one["id"], [node["html"][:200] for node in one["nodes"]])
            for one in page.evaluate("options => axe.run(options)", options)["violations"]
            if one["impact"] in ("serious", "critical")
        ]
    return found


def _registration() -> dict[str, Any]:
    matches = []
    for number in range(12):
        turn, used = 0.5 * number, number != 5
        center = RADIUS * np.array([np.cos(turn), np.sin(turn), 0.2])
        outward = center / np.linalg.norm(center)
        matches.append(
            {
                "name": f"AA{number:04d}", "center_m": center.tolist(), "used": used,
                "residual_m": (0.01 * (number + 1) * outward).tolist(),
                "cause": None if used else "outlier", "reason": "" if used else "residual > 4 σ",
            }
        )  # fmt: skip
    head = {"model": "similarity", "verdict": "accepted", "n_used": 11, "n_rejected": 1}
    return {**head, "per_mapola": matches}


def _scale() -> dict[str, Any]:
    pairs = [
        {
            "image": f"P{k}", "epsilon": (200 + 10 * k) * 1e-6, "epsilon_sigma": 5e-6,
            "longitude_deg": 30.0 * k, "local_time_h": 8.0 + k, "used": k != 3,
        }
        for k in range(8)
    ]  # fmt: skip
    days = [
        {"day": f"2019-07-0{k}", "n": 4, "epsilon": (220 + k) * 1e-6, "epsilon_sigma": 9e-6}
        for k in (1, 2)
    ]
    return {
        "epsilon": 234e-6, "epsilon_sigma": 20e-6, "method": "pairs", "verdict": "accepted",
        "per_pair": pairs, "per_day": days, "reasons": ["range_bias_m: not determined"],
    }  # fmt: skip
