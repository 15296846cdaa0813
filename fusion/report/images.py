"""The page about the images of a workspace: what they show, and how they fit their states."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from fusion.report.layout import html_page, html_table, number_text
from fusion.report.layout.html import TEXT_CELL, html_list
from spcola.arrays import AnyArray

__all__ = ["image_page", "thumbnail"]

_SIDE = 96
_HEAD = (
    "image", "", "original", "shows", "range, m", "m/pixel", "phase, °", "emission, °", "lit, %",
    "orientation", "correlation", "offset, pixel, line", "silhouette", "flags",
)  # fmt: skip


def image_page(
    body: str,
    content: Mapping[str, Any],
    remarks: Sequence[str],
    thumbnails: Mapping[str, str],
    versions: Mapping[str, str],
) -> str:
    """Return the page as self-contained HTML.

    Parameters
    ----------
    body : str
        Its name.
    content : mapping
        As of ``spcola images --report --json``: counts, orientations, offset_rms_px, images.
    remarks : sequence of str
        What is doubtful, a line for each image.
    thumbnails : mapping of str to str
        Data URI by the name of the image; may be empty.
    versions : mapping of str to str
        Programs and their versions.
    """
    counts = html_table(
        ["", "images"], [[escape(key), str(n)] for key, n in content["counts"].items()]
    )
    turns = html_table(
        ["orientation", "images"],
        [[escape(key), str(n)] for key, n in content["orientations"].items()],
        caption="Fit the shape at their states",
    )
    offsets = [number_text(value, 0.1) for value in content["offset_rms_px"]]
    about = (
        "<p>Correlation with the rendered shape at the best offset; the silhouette is the lit "
        "ground that image and rendering both show over that which one shows, at the best offset. "
        f"Offsets are {offsets[0]} pixels and {offsets[1]} lines rms.</p>"
    )
    table = html_table(_HEAD, [_row(one, thumbnails) for one in content["images"]])
    sections = [
        ("counts", "Counts", f'<div class="tables">{counts}{turns}</div>'),
        ("doubtful", "Doubtful images", html_list("", remarks) or "<p>None.</p>"),
        ("images", "Images", about + table),
    ]
    title = f"{body}: images"
    return html_page(title, title, sections, versions)


def thumbnail(pixels: AnyArray) -> str:
    """Return a small grey picture of pixels (R, C) as a data URI (PNG)."""
    from matplotlib.image import imsave  # noqa: PLC0415  (0.4 s at start-up)

    step = max(1, -(-max(pixels.shape) // _SIDE))
    small = pixels[::step, ::step].astype(np.float64)
    stream = io.BytesIO()
    top = max(float(np.percentile(small, 99.5)), 1.0)
    imsave(stream, small, cmap="gray", vmin=0.0, vmax=top, format="png")
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"


def _row(one: Mapping[str, Any], thumbnails: Mapping[str, str]) -> list[str]:
    """Return the cells of one image."""
    fit = one["fit"] or {}
    picture = thumbnails.get(one["name"])
    offset = [number_text(value, 0.1) for value in fit.get("offset_px", ())]
    return [
        escape(one["name"]),
        f'<img alt="" src="{picture}">' if picture else "",
        f"{TEXT_CELL}{escape(one['original'])}",
        escape(one["scene"]),
        number_text(one["range_m"], 1.0),
        number_text(one["resolution_m"]),
        number_text(one["phase_deg"], 0.1),
        number_text(one["emission_deg"], 0.1),
        number_text(100.0 * one["lit_share"], 1.0),
        escape(str(fit.get("turn") or "–")),
        number_text(fit.get("correlation"), 0.01),
        ", ".join(offset) or "–",
        number_text(fit.get("overlap"), 0.01),
        f"{TEXT_CELL}{escape(', '.join(one['flags']))}",
    ]
