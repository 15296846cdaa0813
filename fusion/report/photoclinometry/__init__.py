"""Maplets solved from images: goodness of fit, images next to renderings, the report's section."""

from fusion.report.photoclinometry.comparing import image_strip
from fusion.report.photoclinometry.gather import SolvedMaplets, gather_solved, solved_inputs
from fusion.report.photoclinometry.goodness import goodness_index, read_goodness, residual_limit
from fusion.report.photoclinometry.section import solved_section
from fusion.report.photoclinometry.strips import strip_png

__all__ = [
    "SolvedMaplets",
    "gather_solved",
    "goodness_index",
    "image_strip",
    "read_goodness",
    "residual_limit",
    "solved_inputs",
    "solved_section",
    "strip_png",
]
