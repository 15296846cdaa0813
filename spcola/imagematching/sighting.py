"""Ground of known form in images: matches in all of them, and the resulting place."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import SpcImage, project_image
from spcola.control.estimation import (
    LandmarkSolution,
    by_position_and_pointing,
    solve_landmark,
    state_partials,
)
from spcola.errors import NotObservableError
from spcola.grids import Maplet
from spcola.imagematching.image_match import ImageMatch, ImageMatchOptions, match_image
from spcola.photometry import ortho_rectify, render_view, view_of
from spcola.photometry.functions import PhotometricFunction, lunar_lambert
from spcola.photometry.image_blur import ImageBlurs
from spcola.shape import RayCaster

# Search radius of a match once the place is known, cells.
_NEAR = 3.0
# Images further off than so many standard deviations contradict the others.
_REJECT = 4.0


@dataclass(frozen=True)
class SightOptions:
    """Settings of the search for ground in images.

    Parameters
    ----------
    capture_m : float
        Largest displacement that is searched, metres.
    function : PhotometricFunction
    psf_px : float
        Standard deviation of the optics' point spread, pixels, of images without a blur of their
        own.
    blurs : ImageBlurs
        Of images that have one.
    min_correlation : float
        Smallest correlation of ortho-image and rendering.
    rounds : int
        Most rounds of projecting the images onto the ground at its last solved place.
    tolerance_cells : float
        Rounds end when the place changes by less, grid steps.
    """

    capture_m: float = 2.0
    function: PhotometricFunction = lunar_lambert
    psf_px: float = 0.0
    blurs: ImageBlurs = field(default_factory=ImageBlurs)
    min_correlation: float = 0.5
    rounds: int = 4
    tolerance_cells: float = 0.02


@dataclass(frozen=True, eq=False)
class Sighting:
    """Measured places in N images of the centre of a piece of ground.

    Attributes
    ----------
    name : str
    start : (3,) ndarray
        V as stated, body-fixed, metres.
    images : tuple of SpcImage
        States, without pixels.
    observed : (N, 2) ndarray
        Pixel and line of V.
    covariance : (N, 2, 2) ndarray
        Covariance of each match, pixels².
    states : (N, 6, 6) ndarray
        Covariances of the images' states, as :func:`spcola.control.estimation.state_covariance`.
    correlation, share : (N,) ndarrays
        Correlation of ortho-image and rendering; share of the grid that was compared.
    left_out : mapping of str to str
        Images that were tried and not used, and why.
    """

    name: str
    start: FloatArray
    images: tuple[SpcImage, ...]
    observed: FloatArray
    covariance: FloatArray
    states: FloatArray
    correlation: FloatArray
    share: FloatArray
    left_out: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.images)

    def scaled(self, match: float, position: float, pointing: float) -> Sighting:
        """Return a copy with the sigmas of its matches and states multiplied by factors.

        They are `match` of the places in images, `position` and `pointing` of the states.
        """
        by_position, by_pointing = by_position_and_pointing(self.states)
        states = position**2 * by_position + pointing**2 * by_pointing
        return replace(self, covariance=match**2 * self.covariance, states=states)

    def solve(self, start: FloatArray | None = None) -> LandmarkSolution:
        """Return the place determined by the images [9, 10].

        Parameters
        ----------
        start : (3,) ndarray, optional
            First guess of the place, body-fixed, metres.

        Raises
        ------
        NotObservableError
            If the images leave a direction free.
        """
        return solve_landmark(
            self.start if start is None else start,
            self.images,
            self.observed,
            self.covariance,
            state_covariance=self.states,
        )

    def of(self, keep: Sequence[int], left_out: Mapping[str, str]) -> Sighting:
        """Return a copy with the images at places `keep`; `left_out` are others, and why."""
        chosen = list(keep)
        return replace(
            self,
            images=tuple(self.images[k] for k in chosen),
            observed=self.observed[chosen],
            covariance=self.covariance[chosen],
            states=self.states[chosen],
            correlation=self.correlation[chosen],
            share=self.share[chosen],
            left_out={**self.left_out, **left_out},
        )

    def spread_by(self, states: FloatArray, point: FloatArray) -> FloatArray:
        """Covariances (N, 2, 2), pixels², of a point's place due to `states` (N, 6, 6)."""
        rows = np.array([state_partials(image, point) for image in self.images])
        return rows @ states @ np.swapaxes(rows, 1, 2)


def find_ground(
    ground: Maplet,
    images: Sequence[SpcImage],
    states: Mapping[str, FloatArray],
    *,
    exposed: Callable[[SpcImage], SpcImage],
    beyond: RayCaster | None = None,
    options: SightOptions | None = None,
) -> Sighting:
    """Find ground of known form in images.

    Each image is ortho-rectified onto the ground, the ground is rendered as the image should show
    it, and both are matched. The place solved from all matches is used in the next round.

    Parameters
    ----------
    ground : Maplet
        Heights, in a frame with an error within the capture range.
    images : sequence of SpcImage
        Candidates.
    states : mapping of str to (6, 6) ndarray
        Covariances of the states, by the images' names.
    exposed : callable
        Returns an image with its pixels, if it has any.
    beyond : RayCaster, optional
        The whole body, for occlusion and shadow by other ground.
    options : SightOptions, optional

    Returns
    -------
    Sighting
        Without images where none shows it, or all contradict one another.
    """
    options = options or SightOptions()
    place, found = ground.grid.center, _none(ground, {})
    for round_number in range(options.rounds):
        reach = options.capture_m / ground.grid.gsd if round_number == 0 else _NEAR
        there = replace(ground, grid=replace(ground.grid, center=place))
        seen = [_match(there, exposed(image), beyond, reach, options) for image in images]
        found = agreeing(_sighted(ground, there, images, states, seen))
        if not len(found):
            return found
        before, place = place, found.solve(place).estimate
        if float(np.linalg.norm(place - before)) < options.tolerance_cells * ground.grid.gsd:
            break
    return found


def agreeing(sighting: Sighting) -> Sighting:
    """Return a sighting without the images that contradict the others.

    The worst one is removed first, as long as its distance from the place by the others exceeds
    four standard deviations, or four times their median distance, whichever is larger. Without
    images, each with a reason, where too few are left to determine the place.
    """
    left_out: dict[str, str] = {}
    keep = list(range(len(sighting)))
    while keep:
        some = sighting.of(keep, left_out)
        try:
            off = _off(some, some.solve())
            if len(keep) < 3:
                return some
            worst = int(np.argmax(off))
            rest = sighting.of([k for k in keep if k != keep[worst]], left_out)
            others = rest.solve()
        except NotObservableError:
            if len(keep) > 2:
                return some
            alone = "no other image is there to determine the place with it"
            return sighting.of([], left_out | {image.name: alone for image in some.images})
        usual = max(1.0, float(np.median(_off(rest, others))))
        if _off(sighting.of([keep[worst]], {}), others)[0] <= _REJECT * usual:
            return some
        left_out[some.images[worst].name] = "contradicts the other images"
        keep.remove(keep[worst])
    return sighting


def _off(sighting: Sighting, solution: LandmarkSolution) -> FloatArray:
    """Distance (N,) of each image's ground from a solved place, standard deviations."""
    place = solution.estimate
    seen = np.array([project_image(image, place) for image in sighting.images])
    variance = sighting.covariance + sighting.spread_by(sighting.states, place)
    residual = sighting.observed - seen
    weighed = np.linalg.solve(variance, residual[..., None])[..., 0]
    return np.sqrt(np.sum(weighed * residual, axis=1) / 2.0)


def _match(
    ground: Maplet,
    image: SpcImage,
    beyond: RayCaster | None,
    reach: float,
    options: SightOptions,
) -> tuple[ImageMatch, FloatArray]:
    """Match one image; return the match and the footprint (2, 2), pixels a grid step."""
    view = view_of(image, ground.grid, ground.height, beyond=beyond)
    blur = options.blurs.of(image.name, options.psf_px)
    rendered = render_view(view, function=options.function, blur=blur)
    matching = ImageMatchOptions(capture_cells=reach, min_correlation=options.min_correlation)
    return match_image(ortho_rectify(image, view), rendered, options=matching), view.footprint


def _sighted(
    ground: Maplet,
    there: Maplet,
    images: Sequence[SpcImage],
    states: Mapping[str, FloatArray],
    seen: Sequence[tuple[ImageMatch, FloatArray]],
) -> Sighting:
    """Convert shifts on the grid to pixel and line of its centre."""
    left_out = {match.image: match.reason for match, _ in seen if not match.usable}
    good = [item for item in zip(images, seen, strict=True) if item[1][0].usable]
    if not good:
        return _none(ground, left_out)
    center, size = there.grid.center, float(np.prod(there.grid.shape))
    return Sighting(
        ground.name,
        ground.grid.center,
        tuple(image for image, _ in good),
        np.array(
            [
                np.array(project_image(image, center)) + footprint @ match.shift
                for image, (match, footprint) in good
            ]
        ),
        np.array([footprint @ match.covariance @ footprint.T for _, (match, footprint) in good]),
        np.array([states[image.name] for image, _ in good]),
        np.array([match.correlation for _, (match, _) in good]),
        np.array([match.points / size for _, (match, _) in good]),
        left_out,
    )


def _none(ground: Maplet, left_out: Mapping[str, str]) -> Sighting:
    """Return a sighting without images."""
    return Sighting(
        ground.name, ground.grid.center, (), np.zeros((0, 2)), np.zeros((0, 2, 2)),
        np.zeros((0, 6, 6)), np.zeros(0), np.zeros(0), left_out,
    )  # fmt: skip
