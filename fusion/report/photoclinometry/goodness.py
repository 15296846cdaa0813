"""Goodness of fit per maplet and per image, from ``photoclinometry.json`` or ``albedo.json``."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fusion.report.photoclinometry.albedo import as_solved, goodness_path
from fusion.workspace import Workspace
from spcola.errors import FormatError

# Residuals are drawn up to so many times the median residual of a maplet's images.
_DRAWN_SIGMAS = 3.0
_HEADS = (
    "options", "outcomes", "residual_start", "residual", "shift_m", "photometry_ratios", "findings",
)  # fmt: skip
_FITS = ("used", "not-seen", "contradicts", "sun-reversed")
_SHARED = ("residual", "noise_ratio", "correlation", "shift_px", "shift_m")
_OF_MAPLETS = ("outcome", "residual_start", *_SHARED, "sigma_m")


def read_goodness(workspace: Workspace) -> dict[str, Any] | None:
    """Return the content of ``photoclinometry.json``; None if the solution has none.

    That of ``albedo.json`` has the same keys then: heights are kept.

    Parameters
    ----------
    workspace : Workspace

    Raises
    ------
    WorkspaceError
        If it cannot be read.
    FormatError
        If it lacks what is shown.
    """
    path = goodness_path(workspace)
    content = workspace.find_json(path.name)
    if content is None:
        return None
    albedo = path != workspace.photoclinometry_path
    try:
        content = as_solved(content) if albedo else content
        goodness_index(content)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        do = f"solve the maplets again: spcola spc {'albedo' if albedo else 'lithos'}"
        raise FormatError(f"lacks what is shown ({error!r})", path, do) from error
    return content


def goodness_index(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row for each maplet and each image, and what holds for all.

    Parameters
    ----------
    content : mapping
        Of ``photoclinometry.json``.

    Returns
    -------
    dict
        `options`, `outcomes`, `residual_start`, `residual`, `shift_m`, `photometry_ratios` (None
        in solutions of former versions) and `findings` as they are;
        `maplets`: `name`, `outcome`, goodness of fit (`residual`, `noise_ratio`, `correlation`,
        `shift_px`, `shift_m`), `sigma_m`, changes of the last round (`height_m`, `albedo`),
        numbers of images by fit (`used`, `not_seen`, `contradicts`, `sun_reversed`) and the `codes`
        of other findings that name it; `images`: the same without what only maplets have, and
        numbers of maplets. What is not known is None.
    """
    codes = _codes(content["findings"])
    return {
        **{key: content.get(key) for key in _HEADS},
        "maplets": [
            _maplet_row(name, one, codes[name]) for name, one in content["maplets"].items()
        ],
        "images": [_image_row(name, one, codes[name]) for name, one in content["images"].items()],
    }


def residual_limit(maplet: Mapping[str, Any]) -> float:
    """Return up to which relative residual those of a maplet are drawn: of all images the same.

    Parameters
    ----------
    maplet : mapping
        Of ``photoclinometry.json``.
    """
    return _DRAWN_SIGMAS * (maplet["residual"] or 0.1)


def worst_images(maplet: Mapping[str, Any]) -> list[str]:
    """Return the images that show a maplet, the one with most left over its noise first.

    Parameters
    ----------
    maplet : mapping
        Of ``photoclinometry.json``.
    """
    seen = {name: fit for name, fit in maplet["images"].items() if fit["fit"] != "not-seen"}
    return sorted(seen, key=lambda name: (-noise_ratio(seen[name]), name))


def noise_ratio(fit: Mapping[str, Any]) -> float:
    """Return the residual of an image over its noise; 0 where unknown.

    Parameters
    ----------
    fit : mapping
        Of an image, in that of a maplet.
    """
    return float(fit["residual"] / fit["noise"]) if fit.get("noise") else 0.0


def _codes(findings: Sequence[Mapping[str, Any]]) -> Mapping[str, list[str]]:
    """Return the codes of findings by the names of maplets and images."""
    found = defaultdict(list)
    for one in findings:
        for name in one["names"]:
            found[str(name)].append(str(one["code"]))
    return found


def _maplet_row(name: str, one: Mapping[str, Any], codes: list[str]) -> dict[str, Any]:
    last = one["rounds"][-1] if one["rounds"] else {}
    fits = [fit["fit"] for fit in one["images"].values()]
    return {
        "name": name,
        **{key: one.get(key) for key in _OF_MAPLETS},
        **{key: last.get(key) for key in ("height_m", "albedo")},
        **{key.replace("-", "_"): fits.count(key) for key in _FITS},
        # The outcome has its own column.
        "codes": [code for code in codes if code != one["outcome"]],
    }


def _image_row(name: str, one: Mapping[str, Any], codes: list[str]) -> dict[str, Any]:
    return {
        "name": name,
        **{key: one.get(key) for key in _SHARED},
        **{key.replace("-", "_"): one["fits"].get(key, 0) for key in _FITS},
        "codes": codes,
    }


def chosen_maplets(content: Mapping[str, Any], most: int) -> dict[str, str]:
    """Return maplets worth looking at, each with the reason: all of them if they are few.

    Parameters
    ----------
    content : mapping
        Of ``photoclinometry.json``.
    most : int
        Most maplets.

    Returns
    -------
    dict of str to str
        The worst first, at least one of the best and a typical one among them.
    """
    known = {name: one["residual"] for name, one in content["maplets"].items() if one["residual"]}
    order = sorted(known, key=lambda name: (-known[name], name))
    if len(order) <= most:
        return dict.fromkeys(order, "")
    typical = int(np.argsort(list(known.values()), kind="stable")[len(known) // 2])
    chosen = {order[0]: "largest residual"}
    for one in content["findings"]:
        name = next((each for each in order if each in one["names"]), None)
        if name is not None:
            chosen.setdefault(name, f"the worst of {one['code']}")
    chosen = dict(list(chosen.items())[: most - 2])
    chosen.setdefault(list(known)[typical], "a typical residual")
    chosen.setdefault(order[-1], "smallest residual")
    others = [name for name in order if name not in chosen][: most - len(chosen)]
    return chosen | dict.fromkeys(others, "among the largest residuals")
