"""Albedo planted on solved maplets: how far would it go with slopes, seen from these places?

Of a solution that `spcola spc lithos` made of real images. Each maplet gets its solved heights and
an albedo that owes nothing to slopes, a smooth random field as strong as the solved one. Its images
are predicted with the model of the solver and noise, and solved again from the shape. Where the
albedo then goes with slopes, light and places of the images are the reason. `--planted` predicts
with other photometric functions than the solution assumes: what their errors do.

    python scripts/bench/photoclinometry_planted.py WORKSPACE --solution NAME [--every 1]
        [--noise 0.02 0.05] [--planted FUNCTION ...]

Only every so many of its solved maplets are compared. The multiple correlation of the albedo with
both slopes is printed for the solution itself, for what was planted, and for what is found; and the
correlation of that with what was planted. All are medians over maplets.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from maplets.albedo import by_slopes
from scipy import ndimage

from fusion.runtime.machine.threads import one_blas_thread
from fusion.stages.lithos import LithosOptions
from fusion.stages.lithos.constraining import ConstrainingHeights
from fusion.stages.register import ImageScene
from fusion.workspace import Workspace
from fusion.workspace.settings.processing import RegisterSettings
from spcola.camera import SpcImage, project_image
from spcola.grids import Maplet
from spcola.grids.gaps import filled
from spcola.imagematching import ChoiceOptions
from spcola.photometry.functions import photometric_function
from spcola.photometry.image_blur import ImageBlurs
from spcola.photometry.photoclinometry import PhotoclinometryOptions, solve_photoclinometry
from spcola.photometry.photoclinometry.image_equations import ImageState, compare_image
from spcola.photometry.photoclinometry.image_window import ImageWindow
from spcola.photometry.photoclinometry.surface_fit import SurfaceFit
from spcola.shape import RayCaster, shape_heights

# Points along which the planted albedo is alike.
SMOOTH = 1.0
# Fewest points of a maplet that are compared.
FEWEST = 500


@dataclass(frozen=True, eq=False)
class Solved:
    """Maplets of a solution, their images, heights of the shape, and how they were solved."""

    space: Workspace
    scene: ImageScene
    heights: ConstrainingHeights
    options: PhotoclinometryOptions

    @classmethod
    def of(cls, workspace: Path, solution: str) -> Solved:
        """Read a solution."""
        space = Workspace.open(workspace, solution)
        used = space.read_json("photoclinometry.json")["options"]
        grids = {name: space.maplet(name).grid for name in space.maplet_names()}
        scene = ImageScene.of(space, list(grids.values()), RegisterSettings())
        function = photometric_function(used["photometry"])
        choice = ChoiceOptions(most=used["max_images"], light=function)
        options = PhotoclinometryOptions(
            function,
            used["psf_px"],
            ImageBlurs.of_json(used.get("image_blur", ())),
            independent_start=True,
        )
        scene = replace(scene, choice=choice)
        heights = ConstrainingHeights.of(
            space, grids, scene, LithosOptions(start="shape", photoclinometry=options)
        )
        return cls(space, scene, heights, options)

    @property
    def names(self) -> list[str]:
        """Those that images solved."""
        fits = self.space.read_json("photoclinometry.json")["maplets"]
        kept = {"diverged", "too-few-images"}
        return [name for name, fit in fits.items() if fit["outcome"] not in kept]

    @cached_property
    def spread(self) -> float:
        """Standard deviation of the relative albedo, median over maplets."""
        return float(np.median([np.nanstd(self.space.maplet(n).albedo) for n in self.names]))

    @property
    def beyond(self) -> RayCaster:
        """The shape."""
        assert self.scene.beyond is not None
        return self.scene.beyond

    def planted(self, name: str, noise: float, function: str | None) -> list[float] | None:
        """Plant an albedo on a maplet, and return its four correlations; None of a small one."""
        solved = self.space.maplet(name)
        grid, generator = solved.grid, np.random.default_rng([*name.encode()])
        shape = shape_heights(self.beyond, grid, reach=grid.radius)
        start = Maplet(name, grid, shape)
        field = ndimage.gaussian_filter(generator.normal(size=grid.shape), SMOOTH)
        albedo = 1.0 + self.spread * field / field.std()
        height = np.where(solved.valid, solved.height, filled(shape))
        truth = Maplet(name, grid, height, albedo)
        real = [self.scene.exposed(image) for image in self.scene.showing(grid)]
        states = {image.name: self.scene.states[image.name] for image in real}
        light = self.options
        if function is not None:
            light = replace(light, function=photometric_function(function))
        fit = SurfaceFit.of(truth, real, states, (), [self.beyond], {}, light)
        fit.enter(1)
        images = [
            predicted(image, window, fit, noise, generator)
            for image, window in zip(real, fit.windows, strict=True)
            if window is not None
        ]
        found = solve_photoclinometry(
            start, images, states, constraints=self.heights.on(start), beyond=[self.beyond],
            options=self.options,
        ).maplet  # fmt: skip
        good = np.isfinite(found.albedo) & np.isfinite(solved.albedo)
        if np.count_nonzero(good) < FEWEST or not np.ptp(found.albedo[good]):
            return None
        pairs = (solved.albedo, solved.height), (albedo, height), (found.albedo, found.height)
        return [
            *(by_slopes(one, tall, good, grid.gsd) for one, tall in pairs),
            float(np.corrcoef(found.albedo[good], albedo[good])[0, 1]),
        ]


def predicted(
    image: SpcImage,
    window: ImageWindow,
    fit: SurfaceFit,
    noise: float,
    generator: np.random.Generator,
) -> SpcImage:
    """Return an image of the surface of a fit, as bright as the true one, 0 around the maplet."""
    state = ImageState(1.0, np.zeros(2), np.zeros(2), 1.0)
    seen = compare_image(window, fit.surface, state, fit.options)
    pixels = np.zeros((image.camera.height, image.camera.width))
    if seen.enough:
        pixel, line = project_image(image, fit.start.grid.points(fit.surface.height))
        corner = [
            round(float((place - 0.5 - window.block * own)[0, 0]))
            for place, own in ((line, window.v), (pixel, window.u))
        ]
        scale = np.median(window.pixels[seen.used] / seen.expected[seen.used])
        bright = scale * seen.expected * (1.0 + noise * generator.normal(size=seen.used.shape))
        blocks = np.kron(np.where(seen.used, bright, 0.0), np.ones((window.block, window.block)))
        rows, columns = (
            slice(at, at + size) for at, size in zip(corner, blocks.shape, strict=True)
        )
        pixels[rows, columns] = blocks[: pixels.shape[0] - corner[0], : pixels.shape[1] - corner[1]]
    return replace(image, pixels=pixels, thresholds=(0, 65535))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the correlations for each noise and function."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("workspace", type=Path)
    parser.add_argument("--solution", required=True)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--noise", type=float, nargs="+", default=[0.02, 0.05])
    parser.add_argument("--planted", nargs="*", default=[])
    given = parser.parse_args(arguments)
    solved = Solved.of(given.workspace, given.solution)
    assumed = solved.options.function.name
    print(f"solved with {assumed}; albedo {solved.spread:.3f} (standard deviation)")
    cases = [(noise, None) for noise in given.noise]
    cases += [(given.noise[0], function) for function in given.planted]
    for noise, function in cases:
        with one_blas_thread():
            made = [solved.planted(name, noise, function) for name in solved.names[:: given.every]]
        rows = np.array([one for one in made if one is not None])
        if not len(rows):
            parser.error(
                "no solved maplet has an albedo at enough points: compare more (--every 1)"
            )
        own, planted, found, right = np.median(rows, axis=0)
        print(
            f"{function or 'the same'}, noise {noise:.0%}, {len(rows)} maplets: albedo with slopes "
            f"{own:.3f} in the solution, planted {planted:.3f}, found {found:.3f}; found with "
            f"planted albedo {right:.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
