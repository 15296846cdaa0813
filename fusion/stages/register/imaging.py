"""The images of a workspace for registration by images."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fusion.pipeline import StageContext
from fusion.registration.observations import ImagedMapolas, place_mapolas
from fusion.scene import Exposures
from fusion.workspace import Workspace
from fusion.workspace.settings.processing import RegisterSettings
from spcola.arrays import FloatArray
from spcola.camera import SpcImage, project_image
from spcola.control import Landmark
from spcola.control.estimation import MeasuredLandmarks, measured_sigma, state_covariance
from spcola.errors import NotObservableError
from spcola.grids import Maplet, MapletGrid
from spcola.imagematching import ChoiceOptions, Sighting, SightOptions, choose_images, find_ground
from spcola.photometry.functions import photometric_function
from spcola.shape import RayCaster


@dataclass(frozen=True, eq=False)
class ImageScene:
    """Images, covariances of their states, and the shape that may hide ground from them.

    Attributes
    ----------
    workspace : Workspace
    images : tuple of SpcImage
        Images with pixels in IMAGEFILES and a state of known uncertainty; without their pixels.
    states : dict of str to (6, 6) ndarray
        Covariances of their states.
    exposed : Exposures
    beyond : RayCaster, optional
        The shape.
    """

    workspace: Workspace
    images: tuple[SpcImage, ...]
    states: dict[str, FloatArray]
    exposed: Exposures
    beyond: RayCaster | None
    choice: ChoiceOptions = field(default_factory=ChoiceOptions)
    options: SightOptions = field(default_factory=SightOptions)

    @classmethod
    def of(
        cls, workspace: Workspace, grids: list[MapletGrid], table: RegisterSettings
    ) -> ImageScene:
        """Read the states of the images, and the landmarks by which they were solved."""
        known = {path.stem: workspace.landmark(path.stem) for path in landmark_files(workspace)}
        images = [
            image for image in workspace.images() if workspace.exposure_path(image.name).is_file()
        ]
        fixes = [(image, _fixes(image, known)) for image in images]
        sigma_px = measured_sigma(fixes)
        states = {}
        for image, fixed in fixes:
            try:
                anchor = _anchor(image, grids)
                states[image.name] = state_covariance(image, anchor, fixed, sigma_px=sigma_px)
            except NotObservableError:
                continue
        return cls(
            workspace,
            tuple(image for image in images if image.name in states),
            states,
            Exposures(workspace),
            RayCaster(workspace.shape()) if workspace.has_shape() else None,
            ChoiceOptions(most=table.max_images),
            SightOptions(
                capture_m=table.capture_m,
                function=photometric_function(table.photometry),
                min_correlation=table.min_correlation,
            ),
        )

    def showing(self, grid: MapletGrid) -> list[SpcImage]:
        """Return the images with which ground on a grid is matched."""
        return choose_images(grid, self.images, options=self.choice)

    def sighting(self, ground: Maplet) -> Sighting:
        """Match a mapola, or other ground, with the images that show it."""
        return find_ground(
            ground,
            self.showing(ground.grid),
            self.states,
            exposed=self.exposed,
            beyond=self.beyond,
            options=self.options,
        )


def imaged_mapolas(
    context: StageContext, names: list[str], grids: list[MapletGrid]
) -> ImagedMapolas:
    """Match mapolas with images, and solve for their centres.

    Raises
    ------
    NotObservableError
        If no image has pixels and a state of known uncertainty.
    """
    table = context.table(RegisterSettings)
    scene = ImageScene.of(context.workspace, grids, table)
    if not scene.images:
        raise NotObservableError(
            "no image has both pixels and a state of known uncertainty",
            where=context.workspace.root / "IMAGEFILES",
            do='put images there, or set [register] by = "topography"',
        )

    def sighting(name: str) -> Sighting:
        return scene.sighting(context.workspace.mapola(name))

    # A mapola that more images show takes longer.
    sizes = [1.0 + len(scene.showing(grid)) for grid in grids]
    found = context.stream("find mapolas in images", sighting, names, sizes=sizes)
    return place_mapolas(grids, list(found))


def landmark_files(workspace: Workspace) -> list[Path]:
    """Return the existing landmark files."""
    paths = [workspace.home / "LMKFILES" / f"{name}.LMK" for name in workspace.landmark_names()]
    return [path for path in paths if path.is_file()]


def _fixes(image: SpcImage, known: dict[str, Landmark]) -> MeasuredLandmarks:
    """Return the known landmarks of an image that are not deweighted."""
    points = [p for p in image.landmarks if p.name in known and not p.deweighted]
    return MeasuredLandmarks(
        np.array([known[p.name].grid.center for p in points]).reshape(-1, 3),
        np.array([(p.pixel, p.line) for p in points]).reshape(-1, 2),
        np.array([known[p.name].sigma for p in points]).reshape(-1, 3),
    )


def _anchor(image: SpcImage, grids: list[MapletGrid]) -> FloatArray:
    """Return the mean (3,) of the centres in an image: a point on the surface it shows.

    Without centres in it, the centre nearest to the middle of its frame.
    """
    centers = np.array([grid.center for grid in grids])
    normals = np.array([grid.uz for grid in grids])
    facing = np.sum((image.position - centers) * normals, axis=1) > 0.0
    pixel, line = project_image(image, centers)
    aside = np.abs(pixel - (image.camera.width + 1) / 2) / image.camera.width
    down = np.abs(line - (image.camera.height + 1) / 2) / image.camera.height
    off = np.where(facing & np.isfinite(pixel), np.fmax(aside, down), np.inf)
    if (off < 0.5).any():
        middle: FloatArray = np.mean(centers[off < 0.5], axis=0)
        return middle
    if not np.isfinite(off).any():
        raise NotObservableError("looks away from the body", where=image.name)
    return centers[int(np.argmin(off))]
