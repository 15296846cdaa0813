"""The section of the report on maplets solved from images."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

from fusion.report.layout import html_figure
from fusion.report.layout.html import MARKED_CELL, TEXT_CELL
from fusion.report.layout.sortable import Value, sortable_table
from fusion.report.photoclinometry.figure import solved_figure
from fusion.report.photoclinometry.gather import SolvedMaplet, SolvedMaplets
from fusion.report.photoclinometry.goodness import goodness_index, noise_ratio, residual_limit
from fusion.report.photoclinometry.strips import strip_uri
from fusion.runtime.findings import first_names

_Row = Mapping[str, Any]
_Column = tuple[str, str, Callable[[Any], str]]
# Names of a finding that are printed.
_NAMED = 30
# Constraints of a maplet that are listed.
_CONSTRAINTS = 6


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100.0 * value:.1f}"


def _decimals(count: int) -> Callable[[float | None], str]:
    return lambda value: "–" if value is None else f"{value:.{count}f}".replace("-", "−")


def _words(words: str | Sequence[str]) -> str:
    return TEXT_CELL + escape(words if isinstance(words, str) else ", ".join(words))


_FIT: tuple[_Column, ...] = (
    ("residual, %", "residual", _percent),
    ("÷ noise", "noise_ratio", _decimals(2)),
    ("correlation", "correlation", _decimals(3)),
    ("shift, px", "shift_px", _decimals(2)),
    ("shift, m", "shift_m", _decimals(3)),
)
_RARE: tuple[_Column, ...] = (
    ("contradicts", "contradicts", str),
    ("Sun reversed", "sun_reversed", str),
    ("not seen", "not_seen", str),
)
_COUNTS: tuple[_Column, ...] = (("used", "used", str), *_RARE)
_MAPLETS: tuple[_Column, ...] = (
    ("outcome", "outcome", _words), *_FIT,
    ("sigma, m", "sigma_m", _decimals(3)),
    ("change, m", "height_m", _decimals(4)),
    *_COUNTS, ("findings", "codes", _words),
)  # fmt: skip
_IMAGES: tuple[_Column, ...] = (*_FIT, *_COUNTS, ("findings", "codes", _words))


def solved_section(solved: SolvedMaplets) -> str:
    """Return the section as HTML.

    Parameters
    ----------
    solved : SolvedMaplets
    """
    index = goodness_index(solved.content)
    shown = {one.maplet.name for one in solved.shown}
    counts = ", ".join(f"{count} {escape(word)}" for word, count in index["outcomes"].items())
    intro = (
        f"<p>{len(index['maplets'])} maplets: {counts}. Residual of brightness "
        f"{_percent(index['residual_start'])} % at the start, {_percent(index['residual'])} % at "
        f"the end (median). Images lie {_decimals(3)(index['shift_m'])} m from where their states "
        f"put them (root mean square over maplets and images, on the ground).</p>{_function(index)}"
    )
    about = (
        "<p>Residual: robust standard deviation of an image about what is expected, relative, and "
        "over its noise: 1 fits as well as it can. Shift: how far the image lies from where its "
        "state puts it. Of a maplet the median (shifts: root mean square) over its images, of an "
        "image over its maplets. Change: of heights in the last round (robust standard deviation). "
        "Triangles sort.</p>"
    )
    maplets = _table("maplets", "maplet", _MAPLETS, index["maplets"], shown)
    images = _table("images", "image", _IMAGES, index["images"], set())
    views = "".join(_view(one, solved.content["maplets"][one.maplet.name]) for one in solved.shown)
    return (
        f"{intro}{_findings(index['findings'])}<h3>Goodness of fit of the maplets</h3>{about}"
        f"{maplets}<h3>Goodness of fit of the images</h3>{images}{_heading(solved)}{views}"
    )


def _function(index: _Row) -> str:
    """Return the photometric function, and how images fit with others."""
    used = f"Photometric function: {escape(index['options']['photometry'])}"
    likely = index["options"].get("other_photometry")
    if likely is not None:
        used += f" (in sigmas also: {escape(', '.join(likely)) or 'no other is as good'})"
    ratios = index["photometry_ratios"]
    if not ratios:
        return f"<p>{used}; not compared with others.</p>"
    others = ", ".join(
        f"{escape(name)} {_decimals(2)(ratio)}" for name, ratio in sorted(ratios.items())
    )
    return (
        f"<p>{used}. Residual of brightness with others, over that with it, on a coarse grid "
        f"(median): {others}. Below 0.95 another one fits better.</p>"
    )


def _findings(findings: Sequence[_Row]) -> str:
    """Return outliers by code, and what to do with them."""
    items = []
    for one in findings:
        names = escape(first_names(one["names"], _NAMED))
        items.append(f"<li><code>{escape(one['code'])}</code> {names}: {escape(one['do'])}</li>")
    return f'<ul class="reasons">{"".join(items)}</ul>' if items else "<p>No outliers.</p>"


def _table(
    key: str, what: str, columns: Sequence[_Column], rows: Sequence[_Row], shown: set[str]
) -> str:
    """Return a table of rows, the largest residual first; names link to what is shown.

    Rare columns are left out where nothing is in them.
    """
    columns = [one for one in columns if one not in _RARE or any(row[one[1]] for row in rows)]
    worst = sorted(rows, key=lambda row: (-(row["residual"] or 0.0), row["name"]))
    cells = [[_name(row["name"], shown), *(_cell(row, one) for one in columns)] for row in worst]
    values = [[row["name"], *(_value(row[one[1]]) for one in columns)] for row in worst]
    return sortable_table(f"solved-{key}", [what, *(one[0] for one in columns)], cells, values)


def _name(name: str, shown: set[str]) -> str:
    text = escape(name)
    return f'<a href="#solved-{text}">{text}</a>' if name in shown else text


def _cell(row: _Row, column: _Column) -> str:
    _, key, text = column
    marked = key in ("contradicts", "sun_reversed") and row[key] > 0
    return f"{MARKED_CELL if marked else ''}{text(row[key])}"


def _value(value: Any) -> Value:
    """Return what a cell is sorted by: of codes their number and text, none first."""
    return f"{len(value)} {' '.join(value)}" if isinstance(value, list) else value


def _heading(solved: SolvedMaplets) -> str:
    """Say what the pictures of maplets show."""
    every = len(solved.shown) == len(solved.content["maplets"])
    others = "" if every else " Others are in the page of <code>spcola serve</code>."
    return (
        "<h3>Maplets and their images</h3><p>Each image on the grid of the maplet: as it is, as "
        "the surface lets expect it, and the residual (blue: darker, red: brighter than expected). "
        "Each point has the value of its pixel, which may be larger than a grid step. Pale green: "
        f"not seen; in residuals also shadow and saturated pixels.{others}</p>"
    )


def _view(one: SolvedMaplet, content: _Row) -> str:
    """Return a maplet, folded: figure, and its images with their numbers."""
    name = escape(one.maplet.name)
    why = f": {escape(one.why)}" if one.why else ""
    figure = html_figure(
        solved_figure(one.maplet, content["rounds"], one.directions),
        _caption(content),
        f"solved {name}",
        "png",
    )
    strips = "".join(
        _strip(image, content["images"][image], strip_uri(codes))
        for image, codes in one.strips.items()
    )
    seen = sum(fit["fit"] != "not-seen" for fit in content["images"].values())
    limit = _percent(residual_limit(content))
    rest = f" The {len(one.strips)} worst of {seen}." if seen > len(one.strips) else ""
    about = f"Image, rendering, residual (colours from −{limit} % to {limit} %).{rest}"
    # A link to what is inside unfolds it.
    return (
        f'<details class="solved"><summary>{name}{why} '
        f"<span>{escape(content['outcome'])}, residual {_percent(content['residual'])} %</span>"
        f'</summary><div id="solved-{name}">{figure}{_constraints(content)}<p>{about}</p>'
        f'<div class="strips">{strips}</div></div></details>'
    )


def _caption(content: _Row) -> str:
    how = f"{escape(content['outcome'])}: {escape(content['reason'])}."
    if not content["directions"]:
        return how
    zero, one, two = (f"{100.0 * share:.0f} %" for share in content["directions"])
    # Solutions of former versions do not have it.
    azimuth = content.get("undetermined_azimuth_deg")
    across = "" if azimuth is None else f" (not along azimuth {round(azimuth) % 180}°)"
    return (
        f"{how} Images determine the slope in two "
        f"directions in {two} of the cells, in one in {one}{across}, in none in {zero}. Dotted "
        "lines: a finer GSD begins."
    )


def _constraints(content: _Row) -> str:
    """Return how far constraining heights lie from the surface, the worst first."""
    fits = content.get("constraints", {})
    worst = sorted(fits, key=lambda name: (-(fits[name]["ratio"] or 0.0), name))
    items = []
    for name in worst[:_CONSTRAINTS]:
        fit = fits[name]
        false = f", {fit['left_out']} left out as false" if fit["left_out"] else ""
        items.append(
            f"{escape(name)} {_decimals(3)(fit['residual_m'])} m, {_decimals(2)(fit['ratio'])} × "
            f"sigma ({fit['heights']} heights{false})"
        )
    more = f"; {len(fits) - len(items)} others are nearer" if len(fits) > len(items) else ""
    return f"<p>Constraining heights less the solved: {'; '.join(items)}{more}.</p>" if fits else ""


def _strip(name: str, fit: _Row, uri: str) -> str:
    """Return one image: strip and numbers."""
    state = "" if fit["fit"] == "used" else f' <strong class="off">{escape(fit["fit"])}</strong>'
    ratio = f", {noise_ratio(fit):.2f} × noise" if fit.get("noise") else ""
    shift = float(sum(part**2 for part in fit["shift_px"] if part is not None) ** 0.5)
    ground = f", {fit['pixel_m']:.3g} m/px" if fit.get("pixel_m") else ""
    return (
        f'<figure><img alt="{escape(name)}: image, rendering, residual" src="{uri}"><figcaption>'
        f"{escape(name)}{state}: residual {_percent(fit['residual'])} %{ratio}, correlation "
        f"{_decimals(2)(fit['correlation'])}, shift {shift:.2f} px{ground}</figcaption></figure>"
    )
