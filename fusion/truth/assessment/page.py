"""The assessment as one self-contained HTML page of figures."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from fusion.products import versions
from fusion.report.layout import html_figure, html_page, html_table, number_text
from fusion.report.planted import planted_table
from fusion.truth.assessment.assessment import Assessment
from fusion.truth.assessment.definitions import definitions
from fusion.truth.assessment.figures import (
    calibration_figure,
    colour,
    distances_figure,
    regions_figure,
    resolution_figure,
)
from fusion.truth.assessment.pictures import errors_figure, examples_figure
from fusion.truth.assessment.score import ModelScore
from fusion.truth.assessment.settings import AssessmentSettings
from fusion.truth.assessment.summary import formu_ratio
from spcola import atomic


def write_page(path: Path, found: Assessment) -> None:
    """Write the page, whole or not at all.

    Raises
    ------
    WorkspaceError
        If it cannot be written.
    """
    atomic.write_text(path, make_page(found))


def make_page(found: Assessment) -> str:
    """Return the assessment as self-contained HTML, with style and figures inside."""
    seed = found.planted.settings.seed
    parts = [("models", "Models", _overview(found))] if found.models else []
    if found.recovered:
        parts.append(("planted", "Planted and recovered", planted_table(found.recovered)))
    for place, score in enumerate(found.models):
        parts.append((f"model{place}", score.name, _model(score, place)))
    parts.append(("definitions", "Definitions", definitions_table(found.settings)))
    title = f"Against the truth: mission of seed {seed}"
    return html_page(title, title, parts, versions())


def _overview(found: Assessment) -> str:
    """Tables and figures that compare the models."""
    formal = found.formal
    formu = float("nan") if formal is None else formal.formu
    scores = found.models
    parts = [
        _distances_table(found),
        html_figure(distances_figure(scores, formu), _DISTANCES, "3D rms of the models"),
        _regions_table(scores),
        html_figure(regions_figure(scores), _REGIONS, "errors by region"),
    ]
    calibration = calibration_figure(scores)
    if calibration is not None:
        parts.append(html_figure(calibration, _CALIBRATION, "calibration of the stated sigmas"))
    parts.append(html_figure(resolution_figure(scores), _RESOLUTION, "resolution"))
    return "".join(parts)


_DISTANCES = (
    "3D rms: root mean square distance of the model's vertices from the closest points of the "
    "truth: of the model as given, after the translation, and after the translation and "
    "rotation (never a scale) that minimise it. Height rms: along Uz, after the planted "
    "similarity. Dashed: FormU, the formal uncertainty of the SPC solution."
)
_REGIONS = (
    "Root mean square of height errors (along Uz, in the planted frame) and of the angles between "
    "the normals of model and truth, by region."
)
_CALIBRATION = (
    "Height errors over the sigmas that the model states. Dashed: 0.683, 0.954 and 1, the values "
    "for correct sigmas and normal errors. A smaller share, or a standard deviation over 1, means "
    "that sigmas are too small."
)
_RESOLUTION = (
    "Left: square of the transfer, the cross-spectrum of model and truth over the truth's "
    "spectrum; below ½ the model contains less than half of the truth's power. Right: coherence; "
    "below ½ there is more noise than truth. Dots and numbers: the wavelength at ½."
)


def _distances_table(found: Assessment) -> str:
    head = ["", "GSD, m", "maplets", "vertices", "3D rms, m", "without offset, m", "optimised, m",
            "offset of the centre x, y, z, m", "FormU / optimised", "resolution, m"]  # fmt: skip
    rows = []
    for score in found.models:
        d = score.distances
        sigma = np.sqrt(np.diag(d.translation.covariance))[:3]
        offset = ", ".join(
            number_text(float(v), float(s))
            for v, s in zip(-d.translation.translation, sigma, strict=True)
        )
        rows.append([
            escape(score.name), number_text(round(score.gsd, 4)),
            f"{score.patches}" if score.frame else "", f"{d.count}", _metres(d.rms),
            _metres(d.rms_without_offset), _metres(d.rms_optimised), offset,
            number_text(formu_ratio(score, found.formal), 0.1),
            number_text(score.transfer.half_power, 0.1),
        ])  # fmt: skip
    return html_table(head, rows, caption=_formal_caption(found))


def _formal_caption(found: Assessment) -> str:
    formal = found.formal
    if formal is None:
        return "There is no FormU, as landmarks or images are missing."
    return (
        f"FormU {formal.formu:.3f} m: {formal.maplets} maplets at {formal.gsd:g} m, "
        f"{formal.observations} observations, {formal.residual_pixels:.2f} pixels; 80 % of the "
        f"maplets below {formal.share_80:.3f} m"
    )


def _regions_table(scores: Sequence[ModelScore]) -> str:
    regions = [region.region for region in scores[0].regions]
    rows = [
        [escape(score.name), *(_metres(region.rms) for region in score.regions)] for score in scores
    ]
    return html_table(["", *regions], rows, caption="Rms of the height errors, m")


def _model(score: ModelScore, place: int) -> str:
    """One model: its regions, its errors over the body, examples."""
    head = ["", "points", "mean, m", "rms, m", "robust std, m", "largest, m", "slopes, °",
            "stated σ, m", "mean of error/σ", "std of error/σ", "within 1 σ",
            "within 2 σ"]  # fmt: skip
    rows = [
        [
            escape(r.region), f"{r.count}", _metres(r.mean), _metres(r.rms), _metres(r.robust),
            _metres(r.largest), number_text(r.slope_rms_deg, 1.0), _metres(r.sigma_rms),
            number_text(r.pull_mean, 0.1), number_text(r.pull_std, 0.1),
            number_text(r.within_1, 0.01), number_text(r.within_2, 0.01),
        ]
        for r in score.regions
    ]  # fmt: skip
    fit = score.distances.rigid
    outcome = "converged" if fit.converged else "did not converge"
    why = f": {escape(fit.reason)}" if fit.reason else ""
    frame = "those of the SPC solution" if score.frame == "spc" else "true body-fixed"
    note = (
        f"<p>Coordinates: {frame}. {score.patches} maplets or patches compared, of "
        f"{score.patches_there}. The optimisation {outcome} after {fit.iterations} iterations{why}."
        "</p>"
    )
    caption = (
        "Height errors, model minus truth along Uz: means in cells of 2° (red: the model is too "
        "high), their histogram (outermost bins: all beyond), and errors over stated sigmas."
    )
    shown = (
        "The patches of smallest, median and largest rms: truth and model lit from the upper left "
        "at 45°, and their difference. Rows run along −Ux, columns along Uy, metres from the "
        "centre."
    )
    errors = html_figure(
        errors_figure(score.errors, colour(place)), caption, "height errors", "png"
    )
    examples = html_figure(examples_figure(score.examples), shown, "examples", "png")
    return note + html_table(head, rows, caption="Errors by region") + errors + examples


def definitions_table(settings: AssessmentSettings) -> str:
    """Return a table of the definitions of all numbers."""
    rows = "".join(
        f"<tr><th>{escape(key)}</th><td class='text'>{escape(text)}</td></tr>"
        for key, text in definitions(settings).items()
    )
    return f'<div class="wide"><table><tbody>{rows}</tbody></table></div>'


def _metres(value: float) -> str:
    """Return a length to a millimetre."""
    return number_text(value, 0.01)
