"""``spcola photometry fit`` of images in two filters, and of images of one scale."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from astropy.io import fits
from command_line import call, called, refused
from photographs import WAVES, Painted
from scipy.ndimage import gaussian_filter

from fusion.workspace import Workspace, new_workspace
from spcola.camera.instrument import Instrument
from spcola.formats.cameras import write_cameras
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid
from spcola.photometry.functions import photometric_function

# The function of each filter, and I/F at normal incidence, emission and phase 0.
PLANTED = {
    "RED": ("akimov-phase eta=0.35 slope=-0.008", 0.06),
    "BLUE": ("akimov-phase eta=0.75 slope=-0.014", 0.04),
}
# Directions to camera and Sun, along south, east and up: phase angles from 5 to 78 degrees.
SIGHTS = [
    ([0.3, 0.0, 1.0], [0.4, 0.0, 1.0]),
    ([-0.4, 0.2, 1.0], [-0.5, 0.6, 0.8]),
    ([0.0, 0.4, 1.0], [0.7, 0.7, 1.0]),
    ([0.1, -0.6, 1.0], [0.2, 0.8, 1.0]),
    ([0.7, 0.4, 1.0], [-0.5, -0.5, 1.0]),
]
PLACES, SIZE = 9, 48
UTC = "2019-01-01T00:00:00"
NOISE = 2e-4
"""Of the images, I/F."""
ALBEDO_ERROR = 0.05
"""Of the maplets, which are grey."""
ROUGH = 0.1
"""Of heights of maplets whose slopes are wrong, metres, correlated over three cells."""
GIVEN = [
    part for name in ("akimov-phase", "lambert", "lommel-seeliger", "minnaert")
    for part in ("--function", name)
]  # fmt: skip


class Toned(Painted):
    """Waves of a photometric function, of heights and albedo that differ from place to place."""

    def __init__(self, grid, starts, function):
        super().__init__(grid)
        self.starts, self.function = starts, function

    def height(self, x, y):
        return super().height(x + self.starts[0], y + self.starts[1])

    def slopes(self, x, y):
        return super().slopes(x + self.starts[0], y + self.starts[1])

    def albedo(self, x, y):
        along = (x + self.starts[2])[..., None] * WAVES[:, 0]
        turns = along + (y + self.starts[3])[..., None] * WAVES[:, 1]
        return 1.0 + ALBEDO_ERROR * np.sqrt(2.0 / len(WAVES)) * np.sin(turns).sum(axis=-1)

    def _brightness(self, eye, beam, sun):
        along = self._along(eye, beam)
        x, y, _ = np.moveaxis(eye + along[..., None] * beam, -1, 0)
        tx, ty = self.slopes(x, y)
        normal = np.stack([-tx, -ty, np.ones_like(tx)], axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        back = -beam / np.linalg.norm(beam, axis=-1, keepdims=True)
        phase = np.arccos(np.clip(back @ sun, -1.0, 1.0))
        cosines = normal @ sun, np.sum(normal * back, axis=-1)
        return self.function(*cosines, phase) * self.albedo(x, y)


def grids():
    """Nine squares of 16 m all around a body of 80 m."""
    steps = np.arange(PLACES) + 0.5
    up = 1.0 - 2.0 * steps / PLACES
    turn = steps * np.pi * (3.0 - np.sqrt(5.0))
    around = np.sqrt(1.0 - up**2)
    normals = np.stack([around * np.cos(turn), around * np.sin(turn), up], axis=1)
    return [MapletGrid.facing(80.0 * normal, normal, 0.5, 16) for normal in normals]


def write_iof(path, iof, filter_):
    unit = fits.PrimaryHDU(iof.astype(np.float32))
    unit.header.update({"DATE-OBS": UTC, "FILTER": filter_})
    unit.writeto(path)


def mission(folder, seed):
    """Maplets whose heights are true; floating-point images of I/F; a table of their states."""
    rng, rows = np.random.default_rng(seed), []
    made = new_workspace(folder / "WS", body="Waves")
    for place, grid in enumerate(grids()):
        starts, name = rng.uniform(0.0, 1e4, 4), f"AA{place:04d}"
        for filter_, (text, albedo) in PLANTED.items():
            ground = Toned(grid, starts, photometric_function(text))
            for k, sight in enumerate(SIGHTS):
                image = ground.photograph(f"{filter_[0]}{place}{k}", *sight, samples=2, size=SIZE)
                iof = albedo / 20000.0 * image.pixels + rng.normal(0.0, NOISE, image.pixels.shape)
                write_iof(folder / f"{image.name}.fit", iof, filter_)
                numbers = np.concatenate([image.scobj, image.axes.ravel(), image.sun])
                rows.append(",".join([image.name, UTC, *map(repr, numbers.tolist())]))
        grey = Maplet(name, grid, ground.heights(), albedo=np.ones(grid.shape))
        write_maplet(made.maplet_path(name), grey)
    head = "image,utc,v0x_m,v0y_m,v0z_m,cxx,cxy,cxz,cyx,cyy,cyz,czx,czy,czz,sunx,suny,sunz"
    (folder / "poses.csv").write_text("\n".join([head, *rows]) + "\n")
    write_cameras(folder / "camera.toml", [Instrument("NAC", image.camera, None, None, None)])
    call(
        "images", made.root, *sorted(folder.glob("*.fit")), "--poses", folder / "poses.csv",
        "--camera", folder / "camera.toml",
    )  # fmt: skip
    return made.root


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return mission(tmp_path_factory.mktemp("filters"), 1)


@pytest.fixture(scope="module")
def fitted(root):
    """What is fitted with a scale for each image, and with one for all of a filter."""
    own = called("photometry", "fit", root, *GIVEN)
    return own, called("photometry", "fit", root, *GIVEN, "--calibrated")


def planted_one(found):
    """The entry of the function with which the images of a filter were made, and its truth."""
    truth = photometric_function(PLANTED[found["filter"]][0])
    entry = next(one for one in found["functions"] if one["name"] == truth.name)
    return entry, dict(zip((one.name for one in truth.parameters), truth.values, strict=True))


@pytest.mark.parametrize("which", [0, 1])
def test_each_filter_gets_its_own_parameters_back_within_their_sigmas(fitted, which):
    filters = fitted[which]["filters"]
    assert [found["filter"] for found in filters] == ["BLUE", "RED"]
    for found in filters:
        assert found["n_images"] == PLACES * len(SIGHTS)
        assert found["preferred"] == "akimov-phase"
        assert found["as_good"] == []
        entry, truth = planted_one(found)
        assert entry["converged"]
        for name, value in truth.items():
            one = entry["parameters"][name]
            assert one["code"] is None
            assert abs(one["value"] - value) < 3.0 * one["sigma"], (found["filter"], name)


def test_one_scale_determines_the_phase_function_and_the_normal_albedo(fitted):
    """The import scales each image by itself, which is undone."""
    for own, common in zip(*(content["filters"] for content in fitted), strict=True):
        (entry, _), (free, _) = planted_one(common), planted_one(own)
        assert free["scale"] is free["scale_sigma"] is None
        albedo = PLANTED[common["filter"]][1]
        assert abs(entry["scale"] - albedo) < 3.0 * entry["scale_sigma"] < 0.03 * albedo
        slope, without = (one["parameters"]["slope"]["sigma"] for one in (entry, free))
        assert slope < 1e-3 < 5e-3 < without
    slopes = [planted_one(found)[0]["parameters"]["slope"] for found in fitted[1]["filters"]]
    apart = slopes[1]["value"] - slopes[0]["value"]
    assert apart == pytest.approx(0.006, abs=3.0 * np.hypot(*(one["sigma"] for one in slopes)))


def test_calibrated_images_get_phase_functions_also_without_a_choice_of_functions(root):
    """Without calibration phase parameters are kept, as no data of such images determine them."""
    given = ("photometry", "fit", root, "--filter", "RED")
    own, common = (called(*given, *more)["filters"][0] for more in ((), ("--calibrated",)))
    parameters = [
        {one["name"].split()[0]: set(one["parameters"]) for one in found["functions"]}
        for found in (own, common)
    ]
    assert parameters[0]["akimov-phase"] == {"eta"}
    assert parameters[1]["akimov-phase"] == {"eta", "slope"}
    assert parameters[1]["lommel-seeliger-exponential"] == {"a", "b", "c"}
    assert {"B0", "h"} <= parameters[1]["hapke-rough"]
    # Hapke's with all four parameters comes as near as the one that was planted.
    assert "akimov-phase" in (common["preferred"], *common["as_good"])
    slope = next(one for one in common["functions"] if one["name"] == "akimov-phase")
    assert slope["parameters"]["slope"]["code"] is None


def test_the_scale_is_printed_and_a_filter_by_itself_is_the_same(root, fitted):
    given = ("photometry", "fit", root, *GIVEN, "--calibrated", "--filter", "RED")
    assert called(*given)["filters"] == [fitted[1]["filters"][1]]
    entry, _ = planted_one(fitted[1]["filters"][1])
    printed = call(*given).stdout
    assert f"λ = {entry['scale']:.6g} ± {entry['scale_sigma']:.2g}" in printed
    assert "known are BLUE, RED" in refused(*given[:-1], "GREEN")


def test_sigmas_contain_the_errors_of_slopes_of_the_maplets(root, fitted, tmp_path):
    """The same images over maplets that are smoothed and noisy."""
    copy, rng = tmp_path / "WS", np.random.default_rng(5)
    shutil.copytree(root, copy)
    made = Workspace.open(copy)
    for name in made.maplet_names():
        maplet = made.maplet(name)
        rough = gaussian_filter(rng.normal(size=maplet.grid.shape), 1.5)
        height = gaussian_filter(maplet.height, 1.5) + ROUGH * rough / rough.std()
        write_maplet(made.maplet_path(name), replace(maplet, height=height))
    content = called("photometry", "fit", copy, *GIVEN, "--calibrated")
    for found, right in zip(content["filters"], fitted[1]["filters"], strict=True):
        (entry, truth), (true_one, _) = planted_one(found), planted_one(right)
        assert true_one["slope_error_deg"] < 1.0 < 2.5 < entry["slope_error_deg"] < 5.0
        assert entry["scale_sigma"] > 1.5 * true_one["scale_sigma"]
        albedo = PLANTED[found["filter"]][1]
        assert abs(entry["scale"] - albedo) < 2.5 * entry["scale_sigma"]
        for name, value in truth.items():
            one, before = entry["parameters"][name], true_one["parameters"][name]
            assert one["sigma"] > 1.5 * before["sigma"]
            assert abs(one["value"] - value) < 2.5 * one["sigma"], (found["filter"], name)


def test_the_most_images_of_a_maplet_are_counted_for_each_filter(root):
    content = called("photometry", "fit", root, *GIVEN, "--max-images", "3")
    assert [found["n_images"] for found in content["filters"]] == 2 * [3 * PLACES]


def test_images_of_unknown_gain_among_others_are_refused(root, fitted, tmp_path):
    copy = tmp_path / "WS"
    shutil.copytree(root, copy)
    path = copy / "images.jsonl"
    lines = path.read_text().splitlines()
    gains = [json.loads(line)["pixels"]["gain"] for line in lines]
    assert max(gains) > 2.0 * min(gains)
    path.write_text("\n".join(lines[2:]) + "\n")
    given = ("photometry", "fit", copy, *GIVEN)
    line = refused(*given, "--calibrated")
    assert "the gain of 88 images, but not of B00 and 1 more" in line
    assert "leave --calibrated out" in line
    assert [one["filter"] for one in called(*given)["filters"]] == ["BLUE", "RED", "unknown"]
    path.unlink()
    assert called(*given, "--calibrated")["filters"][0]["filter"] == "unknown"
