"""The report as one self-contained HTML page."""

from __future__ import annotations

from html import escape

import numpy as np

from fusion.report.data import ReportData, Surfaces
from fusion.report.figures.maps import coverage_figure, registration_figure
from fusion.report.figures.origins import origins_figure
from fusion.report.figures.scale import scale_figure
from fusion.report.figures.surfaces import surfaces_figure
from fusion.report.layout import html_figure, html_page
from fusion.report.layout.sortable import SORTING_STYLE
from fusion.report.photoclinometry import solved_section
from fusion.report.planted import errors_table, planted_table
from fusion.report.tables import (
    checks_table,
    registration_tables,
    rejected_table,
    scale_tables,
    verdicts_box,
)

_SECTIONS = (
    ("origins", "What the surface rests on"),
    ("surfaces", "Surfaces"),
    ("solved", "Maplets from images"),
    ("planted", "Planted and recovered"),
    ("coverage", "Coverage"),
    ("registration", "Registration"),
    ("scale", "Scale"),
)


def make_report(data: ReportData) -> str:
    """Return the report as self-contained HTML, with style and figures inside.

    Missing parts of `data` are stated as missing, except planted values, which only a demo has, and
    maplets from images, which only some solutions have.
    Equal data give equal text.
    """
    parts = {
        "origins": _origins(data),
        "planted": planted_table(data.planted) if data.planted else "",
        "surfaces": "".join(_surfaces(place) for place in data.surfaces)
        or _missing("There are no fused maplets yet."),
        "solved": solved_section(data.solved) if data.solved else "",
        "coverage": _coverage(data),
        "registration": _registration(data),
        "scale": _scale(data),
    }
    return html_page(
        f"{data.body}: lidar and SPC",
        f"{data.body}: lidar and stereophotoclinometry together",
        [(key, title, parts[key]) for key, title in _SECTIONS if parts[key]],
        data.versions or {},
        preface=verdicts_box(data),
        style=SORTING_STYLE if data.solved else "",
    )


def _surfaces(place: Surfaces) -> str:
    """One place: heading, figure, caption."""
    fused = place.fused
    both = np.isfinite(place.lidar) & np.isfinite(fused.height)
    caption = (
        f"{escape(fused.name)}, {fused.grid.size} × {fused.grid.size} points at "
        f"{fused.grid.gsd:.4g} m. Top: hillshades, lit from the upper left at 45°. Middle: "
        "differences of height along Uz, on one colour scale. Bottom: one standard deviation of "
        "the fused height, lidar returns in each cell, and the source of each height. Pale green: "
        f"unknown. The lidar covers {100 * np.mean(both):.0f} % of the points. Rows run along −Ux, "
        "columns along Uy, metres from the centre; N is the direction of the body's north."
    )
    why = f": {escape(place.why)}" if place.why else ""
    figure = html_figure(surfaces_figure(place), caption, f"surfaces of {fused.name}", "png")
    return f"<h3>{escape(fused.name)}{why}</h3>{figure}"


def _origins(data: ReportData) -> str:
    """The map of what the fused heights rest on; how far each surface is from the true one."""
    figure = ""
    if data.origins is not None:
        caption = (
            "What the fused heights rest on: images alone where no return fell, lidar alone where "
            "no image shows lit ground, both elsewhere. Of the points nearest to a pixel the most "
            "frequent source is drawn. Planetocentric coordinates; the polar views end at 30° of "
            "latitude."
        )
        figure = html_figure(
            origins_figure(data.origins), caption, "what the fused heights rest on", "png"
        )
    return (errors_table(data.errors) if data.errors else "") + figure


def _coverage(data: ReportData) -> str:
    """The map of maplets and mapolas."""
    if data.coverage is None or not len(data.coverage.centers):
        return _missing("There are no maplets or mapolas yet.")
    share = data.coverage.share[np.isfinite(data.coverage.share)]
    mean = f"; on average {100 * share.mean():.0f} % of a mapola's points" if share.size else ""
    caption = (
        f"Centres of {len(data.coverage.centers)} maplets, coloured by the share of their points "
        f"with a lidar height{mean}. Planetocentric coordinates."
    )
    return html_figure(coverage_figure(data.coverage), caption, "coverage of the body")


def _registration(data: ReportData) -> str:
    """Numbers and residuals of the registration."""
    if data.registration is None:
        return _missing("There is no registration yet.")
    intro = (
        "<p>The transform maps lidar to SPC coordinates: "
        "V<sub>SPC</sub> = translation + scale · R · V<sub>lidar</sub>.</p>"
    )
    caption = (
        "Top: residual displacement of each mapola after the fit (SPC minus registered lidar); "
        "arrows east and north, their key at the lower right, colour upward. Bottom: the same "
        "along the body-fixed axes; dashed: one standard deviation of those used; the outermost "
        "bins include all beyond."
    )
    figure = html_figure(registration_figure(data.registration), caption, "registration residuals")
    return (
        intro
        + registration_tables(data.registration)
        + checks_table(data.registration)
        + figure
        + rejected_table(data.registration)
    )


def _scale(data: ReportData) -> str:
    """Numbers and figures of the scale."""
    if data.scale is None:
        return _missing("There is no scale yet.")
    intro = (
        "<p>ε &gt; 0 means that the SPC body is too small: all SPC lengths are to be multiplied by "
        "1 + ε. Ranges are then longer than predicted by SPC's trajectory, and shorter than "
        "predicted by an independent one.</p>"
    )
    caption = (
        "ε of paired bigmaps (or single shots): per day, against local solar time and against "
        "longitude. Line and grey band: joint fit and its standard deviation. A slope over the "
        "day would indicate errors of lighting or pointing, a wave once around an offset of the "
        "centre."
    )
    figure = html_figure(
        scale_figure(data.scale), caption, "scale by day, local time and longitude"
    )
    return intro + scale_tables(data.scale) + figure


def _missing(text: str) -> str:
    return f'<p class="missing">{text}</p>'
