"""Errors against the density of the lidar, from the tables of the validation page."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from fusion.report.layout import Colour, styled_figure

PAGE = Path(__file__).parents[1] / "validation" / "photoclinometry.md"
_HEADING = "| returns a cell |"


def density_figure() -> Figure:
    """Errors of heights and slopes against returns a cell: images, lidar, and both."""
    names, rows = _table(PAGE.read_text(encoding="utf-8"))
    colours = {"fused": Colour.FUSED, "images": Colour.SPC, "both": Colour.TEXT}
    with styled_figure(9.4, 3.4) as figure:
        for axes, what, unit in zip(
            figure.subplots(1, 2), ("heights", "slopes"), ("m", "degrees"), strict=True
        ):
            for column, name in enumerate(names[1:], start=1):
                kind, which = name.rsplit(", ", 1)
                if kind != what:
                    continue
                known = [row for row in rows if row[column] is not None]
                axes.plot(
                    [row[0] for row in known], [row[column] for row in known],
                    marker="o", color=colours[which], label=which,
                )  # fmt: skip
            axes.set(
                xscale="log", ylim=(0.0, None), xlabel="returns a cell", ylabel=f"{what}, {unit}"
            )
            axes.legend()
    return figure


def _table(page: str) -> tuple[list[str], list[list[float | None]]]:
    """Return the names of columns, and rows, of the table under the heading; – is None."""
    lines = page[page.index(_HEADING) :].splitlines()
    table = [line.strip("|").split("|") for line in lines[: lines.index("")]]
    names = [cell.strip() for cell in table[0]]
    rows = [[None if "–" in cell else float(cell) for cell in row] for row in table[2:]]
    return names, rows
