"""Layout of the report: style of figures, and elements of pages."""

from fusion.report.layout.figures import CODED_COLOURS, Colour, figure_bytes, styled_figure
from fusion.report.layout.html import data_uri, html_figure, html_page, html_table, number_text

__all__ = [
    "CODED_COLOURS",
    "Colour",
    "data_uri",
    "figure_bytes",
    "html_figure",
    "html_page",
    "html_table",
    "number_text",
    "styled_figure",
]
