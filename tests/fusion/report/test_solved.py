"""Maplets from images in the report: goodness of fit that sorts, and images next to renderings."""

from __future__ import annotations

import io
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import called, refused
from PIL import Image
from solved_workspace import FAR, MAPLET, REVERSED

from fusion.report.layout.sortable import sortable_table
from fusion.report.photoclinometry import goodness_index, image_strip, strip_png
from fusion.report.photoclinometry.figure import solved_figure
from fusion.report.photoclinometry.gather import gather_solved, solved_inputs
from fusion.report.photoclinometry.goodness import chosen_maplets
from fusion.workspace import Workspace
from spcola.formats.slope_directions import slope_directions_path


@pytest.fixture(scope="module")
def report(solved: tuple[Path, dict[str, Any]], tmp_path_factory) -> tuple[Path, str]:
    """A copy of the workspace, and its report."""
    root = tmp_path_factory.mktemp("reported") / "waves"
    shutil.copytree(solved[0], root, symlinks=True)
    found = called("report", root)
    assert found["stage"] == "report"
    return root, (root / "solutions" / "images" / "report.html").read_text(encoding="utf-8")


def test_the_report_has_goodness_of_fit_and_what_to_do(report) -> None:
    page = report[1]
    assert "<script" not in page
    section = page[page.index('<section id="solved">') :]
    assert "1 converged, 1 too-few-images" in section
    assert re.search(rf"<code>sun-reversed</code> {REVERSED}: .*make their states anew", section)
    assert re.search(rf"<code>too-few-images</code> {FAR}: .*bring more images", section)
    images = section[section.index('id="solved-images"') : section.index("Maplets and their")]
    # The worst comes first; a column that is rarely needed is there where something is in it.
    assert images.index(f"<th>{REVERSED}</th>") < images.index("<th>I0</th>")
    assert '<td class="off">1</td>' in images
    assert "contradicts" not in images
    assert f'<a href="#solved-{MAPLET}">' in section
    assert section.count('<figure><img alt="I') == 5


def test_the_report_is_made_anew_when_an_image_changes(report) -> None:
    root = report[0]
    assert called("report", root)["state"] == "up to date"
    image = root / "IMAGEFILES" / "I0.DAT"
    content = bytearray(image.read_bytes())
    content[1000:1010] = bytes(10)
    image.unlink()
    image.write_bytes(content)
    assert called("report", root)["state"] == "ran"


def test_the_report_compares_photometric_functions(report) -> None:
    root, page = report
    assert "<p>Photometric function: lambert; not compared with others.</p>" in page
    workspace = Workspace.open(root)
    content = workspace.read_json("photoclinometry.json")
    content["photometry_ratios"] = {"lunar-lambert": 0.968, "lommel-seeliger": 1.25}
    workspace.photoclinometry_path.unlink()
    workspace.write_json("photoclinometry.json", content)
    assert called("report", root)["state"] == "ran"
    found = workspace.report_path.read_text(encoding="utf-8")
    assert "coarse grid (median): lommel-seeliger 1.25, lunar-lambert 0.97." in found


def test_a_figure_has_the_directions_of_slopes(solved) -> None:
    workspace = Workspace.open(solved[0])
    (shown,) = gather_solved(workspace).shown
    assert shown.directions is not None
    share = solved[1]["maplets"][MAPLET]["directions"]
    counts = np.bincount(shown.directions.count.ravel(), minlength=3)
    np.testing.assert_allclose(counts / counts.sum(), share)
    path = slope_directions_path(workspace.maplet_path(MAPLET))
    assert path in solved_inputs(workspace)
    titles = [
        [panel.get_title(loc="left") for panel in solved_figure(shown.maplet, [], which).axes]
        for which in (shown.directions, None)
    ]
    assert [one.count("directions") for one in titles] == [1, 0]
    figure = solved_figure(shown.maplet, [], shown.directions)
    (panel,) = (one for one in figure.axes if one.get_title(loc="left") == "directions")
    # Seen as an image: rows run along Ux.
    np.testing.assert_array_equal(panel.images[0].get_array(), shown.directions.count.T)


def test_a_strip_shows_image_rendering_and_residual(solved) -> None:
    workspace = Workspace.open(solved[0])
    content = workspace.read_json("photoclinometry.json")
    maplet = workspace.maplet(MAPLET)
    codes = image_strip(workspace, content, maplet, "I0", None)
    size = maplet.grid.size
    assert codes.shape == (size, 3 * size + 4)
    picture = np.asarray(Image.open(io.BytesIO(strip_png(codes))).convert("RGB")).astype(int)
    image, rendering = picture[:, :size], picture[:, size + 2 : 2 * size + 2]
    assert np.corrcoef(image[..., 0].ravel(), rendering[..., 0].ravel())[0, 1] > 0.95
    residual = picture[:, -size:]
    # Red and blue alike, and neither follows the brightness.
    redder = residual[..., 0] - residual[..., 2]
    assert abs(np.mean(redder > 0) - 0.5) < 0.15
    assert abs(np.corrcoef(redder.ravel(), image[..., 0].ravel())[0, 1]) < 0.25
    wrong = image_strip(workspace, content, maplet, REVERSED, None)
    beyond = [np.isin(one[:, -size:], (128, 254)).mean() for one in (codes, wrong)]
    assert beyond[1] > 2.0 * beyond[0]


def test_rows_have_their_ranks_in_each_column() -> None:
    table = sortable_table(
        "t",
        ["name", "x"],
        [["b", "2"], ["a", "–"], ["c", "1"]],
        [["b", 2.0], ["a", None], ["c", 1.0]],
    )
    styles = re.findall(r'<tr style="([^"]*)"', table)
    assert styles == ["--c0:2;--c1:2", "--c0:1", "--c0:3;--c1:1"]


def test_maplets_that_are_shown_are_the_worst_the_best_and_a_typical_one() -> None:
    maplets = {f"A{k:02d}": {"residual": 0.01 * (k + 1)} for k in range(40)}
    findings = [{"code": "diverged", "names": ["A05", "A07"]}]
    chosen = chosen_maplets({"maplets": maplets, "findings": findings}, 6)
    assert chosen == {
        "A39": "largest residual", "A07": "the worst of diverged", "A20": "a typical residual",
        "A00": "smallest residual", "A38": "among the largest residuals",
        "A37": "among the largest residuals",
    }  # fmt: skip
    assert list(chosen_maplets({"maplets": maplets, "findings": findings}, 40)) == sorted(
        maplets, reverse=True
    )


def test_rows_of_an_index_have_counts_and_codes(solved) -> None:
    index = goodness_index(Workspace.open(solved[0]).read_json("photoclinometry.json"))
    rows = {one["name"]: one for one in (*index["maplets"], *index["images"])}
    assert (rows[MAPLET]["used"], rows[MAPLET]["sun_reversed"]) == (4, 1)
    assert rows[MAPLET]["codes"] == []
    assert rows[REVERSED]["codes"] == ["sun-reversed"]
    assert rows[FAR]["residual"] is None
    assert 0.0 < rows[MAPLET]["shift_m"] < 0.1


def test_a_damaged_file_is_named(report) -> None:
    path = report[0] / "solutions" / "images" / "photoclinometry.json"
    path.unlink()
    path.write_text('{"maplets": {"AA0001": {}}, "images": {}, "findings": []}')
    line = refused("report", report[0])
    assert "photoclinometry.json: lacks what is shown" in line
    assert "spcola spc lithos" in line
