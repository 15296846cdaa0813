"""The albedo of fixed topography, over a maplet, a mapola, or a bigmap of any size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.camera import SpcImage
from spcola.errors import InvalidValueError, SettingsError
from spcola.grids import Maplet
from spcola.math.robust import known_median
from spcola.photometry.albedo.fits import Tally
from spcola.photometry.albedo.result import AlbedoOutcome, AlbedoSolution
from spcola.photometry.albedo.windows import FixedGround, Window
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry import PhotoclinometryOptions
from spcola.photometry.photoclinometry.albedo_equations import eliminate_albedo, with_priors
from spcola.photometry.photoclinometry.albedo_prior import AlbedoPrior
from spcola.photometry.photoclinometry.cell_pixels import NUISANCES
from spcola.photometry.photoclinometry.image_equations import (
    ImageState,
    Sums,
    add_image,
    compare_image,
    scaled,
)
from spcola.photometry.photoclinometry.image_window import ImageWindow
from spcola.photometry.photoclinometry.nuisances import (
    changed_state,
    nuisance_priors,
    nuisance_values,
)
from spcola.shape import RayCaster

# Places of the products of both slopes with the albedo in the sums.
_SLOPES_WITH_ALBEDO = (3, 6)
# Standard deviation of the mean over images of the relative change of λ over the grid.
_COMMON = 1e-5
# Of pixels, in place of that of photoclinometry, with which errors of slopes enter the albedo more.
_LEAST_BRIGHTNESS = 0.3
# Views of images over windows that stay in memory, about a megabyte each.
_KEPT = 100


@dataclass(frozen=True)
class AlbedoOptions:
    """Options of :func:`solve_albedo`.

    Parameters
    ----------
    photoclinometry : PhotoclinometryOptions
        Of these count: `function`, `psf_px`, `blurs`, `rounds`, `albedo_sigma`, `convention`,
        `gradient_sigma`, `shift_sigma_px`, `least_error`, `loss_scale`, `settled_albedo`.
        Slopes are known, so that no relief is taken for albedo: cells are independent, and
        `albedo_sigma` is the expected scatter of each.
    slope_error : float
        Standard deviation of each slope of a cell: what it does to brightness is in the sigma.

    Raises
    ------
    SettingsError
        If the slope error is negative or no number.
    """

    photoclinometry: PhotoclinometryOptions = field(
        default_factory=lambda: PhotoclinometryOptions(rounds=12)
    )
    slope_error: float = 0.08

    def __post_init__(self) -> None:
        if not 0.0 <= self.slope_error < np.inf:
            raise SettingsError(f"must not be negative, not {self.slope_error}", "slope_error")


def solve_albedo(
    ground: Maplet,
    images: Sequence[SpcImage],
    states: Mapping[str, FloatArray],
    *,
    beyond: RayCaster | None = None,
    options: AlbedoOptions | None = None,
) -> AlbedoSolution:
    """Return the relative albedo of ground whose heights are known, from its images [21].

    Slopes and heights are fixed; scale λ, its change over the grid, and shift of each image are
    eliminated as in photoclinometry, one of each for the whole grid, so that no step remains
    between its parts. A grid of more than 112 cells is worked on in windows of 96 with margins:
    memory is that of one window, and two bytes for each cell and image. The albedo of the ground
    is not read.

    Parameters
    ----------
    ground : Maplet
        Gaps of up to two cells are bridged for the brightness; wider ones show nothing.
    images : sequence of SpcImage
        With pixels, in the frame of the grid. One is enough.
    states : mapping of str to (6, 6) ndarray
        Covariances of their states: how far each image may be shifted.
    beyond : RayCaster, optional
        The whole body, which hides and shades ground.
    options : AlbedoOptions, optional

    Raises
    ------
    InvalidValueError
        If the ground has no height at all, or an image no pixels.
    """
    options = options or AlbedoOptions()
    if not ground.valid.any():
        raise InvalidValueError("has no height", ground.name)
    for image in images:
        if image.pixels is None:
            raise InvalidValueError("has no pixels", image.name, "put its .DAT into IMAGEFILES")
    work = _Work.of(ground, images, states, beyond, options)
    work.find_scales()
    if not any(np.isfinite(state.spread) for state in work.states):
        return work.nothing()
    residuals, changes = list[float](), list[float]()
    for _ in range(options.photoclinometry.rounds):
        residuals.append(work.residual)
        changes.append(work.round())
        if work.settled(changes):
            break
    return work.result(ground, residuals, changes)


@dataclass(eq=False)
class _Work:
    """What changes from round to round.

    Attributes
    ----------
    albedo : (R − 1, C − 1) ndarray
        Of cells, about 1.
    informed : (R − 1, C − 1) ndarray of bool
        Cells that images determine better than the prior.
    nuisance : (P, P) ndarray
        Normal matrix of the last round, priors included.
    noise : float
        Median sigma of the albedo by noise alone in the last round.
    """

    ground: FixedGround
    windows: list[Window]
    known: FloatArray
    options: AlbedoOptions
    albedo: FloatArray
    informed: BoolArray
    states: list[ImageState]
    nuisance: FloatArray
    noise: float = 0.0
    kept: dict[Window, list[tuple[int, ImageWindow]]] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        ground: Maplet,
        images: Sequence[SpcImage],
        states: Mapping[str, FloatArray],
        beyond: RayCaster | None,
        options: AlbedoOptions,
    ) -> _Work:
        fixed = FixedGround.of(ground, images, beyond)
        return cls(
            fixed,
            fixed.windows(),
            nuisance_priors(images, states, ground.grid.center, options.photoclinometry),
            options,
            np.ones(fixed.known.shape),
            np.zeros(fixed.known.shape, dtype=np.bool_),
            [ImageState.unknown() for _ in images],
            np.zeros((0, 0)),
        )

    @property
    def residual(self) -> float:
        """Median residual of brightness over images, relative."""
        return float(known_median(np.array([state.spread for state in self.states])))

    def views(self, window: Window) -> list[tuple[int, ImageWindow]]:
        """Return number and view of the images over a window; the first ones are kept."""
        if window in self.kept:
            return self.kept[window]
        views = self.ground.views(window)
        if sum(map(len, self.kept.values())) + len(views) <= _KEPT:
            self.kept[window] = views
        return views

    def find_scales(self) -> None:
        """Find λ and spread of each image: medians of those of the windows."""
        own = self.options.photoclinometry
        found: list[list[ImageState]] = [[] for _ in self.states]
        for window in self.windows:
            surface = self.ground.surface(window, self.albedo)
            for k, view in self.views(window):
                compared = compare_image(view, surface, self.states[k], own)
                if compared.enough:
                    pixels, expected = view.pixels[compared.used], compared.expected[compared.used]
                    found[k].append(scaled(pixels, expected, self.states[k], own))
        for k, states in enumerate(found):
            if states:
                scale, spread = np.median([(one.scale, one.spread) for one in states], axis=0)
                self.states[k] = replace(self.states[k], scale=float(scale), spread=float(spread))

    def round(self) -> float:
        """Do one round; return the root mean square change of the albedo.

        The albedo changes at once, as it follows from the images' parameters so far, and these
        afterwards: of a linear system it is exact in the next round.
        """
        spreads = [list[float]() for _ in self.states]
        albedo, normal, right = self._over_windows(spreads)
        before = nuisance_values(self.states)
        self._add_common(normal, right, before)
        self.nuisance, pull = with_priors((normal, right), before, self.known)
        steps = np.linalg.solve(self.nuisance, pull).reshape(-1, NUISANCES)
        for k, (state, found) in enumerate(zip(self.states, spreads, strict=True)):
            spread = float(np.median(found)) if found else state.spread
            self.states[k] = changed_state(replace(state, spread=spread), steps[k])
        convention = self.options.photoclinometry.convention
        albedo = convention.bounded(albedo, self.informed)
        change = (albedo - self.albedo)[self.ground.known]
        self.albedo = albedo
        return float(np.sqrt(np.mean(change**2)))

    @property
    def prior(self) -> AlbedoPrior:
        """What is expected of the albedo: of independent cells, as slopes are known."""
        return AlbedoPrior(self.options.photoclinometry.albedo_sigma)

    def _add_common(self, normal: FloatArray, right: FloatArray, before: FloatArray) -> None:
        """Let the change of λ over the grid that is common to all images be albedo.

        Nothing else separates them, and a prior of independent cells makes a trend of the albedo
        impossible.
        """
        used = [k for k, state in enumerate(self.states) if np.isfinite(state.spread)]
        weight = (_COMMON * len(used)) ** -2.0
        for axis in (1, 2):
            rows = NUISANCES * np.array(used) + axis
            normal[np.ix_(rows, rows)] += weight
            right[rows] -= weight * before[used, axis].sum()

    def _over_windows(
        self, spreads: list[list[float]]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the albedo after its step, and the equations of the images' parameters.

        The spreads of the images in each window are added to `spreads`.
        """
        prior, size = self.prior, NUISANCES * len(self.states)
        normal, right = np.zeros((size, size)), np.zeros(size)
        albedo, noise = self.albedo.copy(), list[FloatArray]()
        for window in self.windows:
            sums, rows = self._sums(window, spreads)
            equations = eliminate_albedo(sums, prior.about(self.albedo[window.cells]))
            equations = equations.with_parameters(window.to_whole)
            albedo[window.inner] += equations.step[window.own]
            weight = equations.weight[window.own]
            self.informed[window.inner] = informed = weight > 2.0 * prior.sigma**-2
            noise.append(weight[informed] ** -0.5)
            normal[np.ix_(rows, rows)] += equations.nuisance
            right[rows] += equations.nuisance_right
        known = np.concatenate(noise)
        self.noise = float(np.median(known)) if known.size else 0.0
        return albedo, normal, right

    def settled(self, changes: Sequence[float]) -> bool:
        """Whether the albedo changes by less than the limit, or a tenth of its sigma by noise.

        Twice in a row: the images' parameters follow the albedo by a round.
        """
        most = max(self.options.photoclinometry.settled_albedo, 0.1 * self.noise)
        return len(changes) > 1 and max(changes[-2:]) < most

    def _sums(
        self, window: Window, spreads: list[list[float]] | None = None
    ) -> tuple[Sums, IntArray]:
        """Return the sums over the inner square of a window, and rows of the images that enter.

        The new spreads of these images are added to `spreads`.
        """
        surface = self.ground.surface(window, self.albedo)
        options = replace(self.options.photoclinometry, least_brightness=_LEAST_BRIGHTNESS)
        views = [(k, v) for k, v in self.views(window) if np.isfinite(self.states[k].spread)]
        sums = Sums.empty(len(views), surface.albedo.shape)
        for place, (k, view) in enumerate(views):
            spread = add_image(
                sums, place, view, surface, window.state(self.states[k]),
                options, cells=window.inside, rescale=False,
            ).spread  # fmt: skip
            if spreads is not None and np.isfinite(spread):
                spreads[k].append(spread)
        places = NUISANCES * np.array([k for k, _ in views], dtype=np.int64)
        return sums, np.add.outer(places, np.arange(NUISANCES)).ravel()

    def nothing(self) -> AlbedoSolution:
        """Return the result without images."""
        unknown, nan = np.full(self.ground.grid.shape, np.nan), float("nan")
        mean = self.options.photoclinometry.convention.mean
        fits = Tally(len(self.states)).fits(self.ground.images, self.states)
        none = AlbedoOutcome.NO_IMAGE
        return AlbedoSolution(unknown, unknown, mean, fits, nan, nan, (), (), none)

    def result(
        self, ground: Maplet, residuals: list[float], changes: list[float]
    ) -> AlbedoSolution:
        """Return the albedo of points, with sigmas and fits."""
        own = self.options.photoclinometry
        variance, tally = np.full(self.albedo.shape, np.nan), Tally(len(self.states))
        covariance = np.linalg.inv(self.nuisance)
        for window in self.windows:
            surface = self.ground.surface(window, self.albedo)
            variance[window.inner] = self._variance(window, covariance)[window.own]
            for k, view in self.views(window):
                state = window.state(self.states[k])
                tally.add(k, window, view, compare_image(view, surface, state, own), state.scale)
        cells = np.where(self.informed, self.albedo, np.nan)
        variance = np.where(self.informed, variance, np.nan)
        return AlbedoSolution(
            own.convention.stated(_at_points(cells, ground.valid)),
            own.convention.stated(np.sqrt(_at_points(variance, ground.valid))),
            own.convention.mean,
            tally.fits(self.ground.images, self.states),
            residuals[0],
            self.residual,
            tuple(changes),
            tuple(residuals),
            AlbedoOutcome.CONVERGED if self.settled(changes) else AlbedoOutcome.NOT_CONVERGED,
        )

    def _variance(self, window: Window, covariance: FloatArray) -> FloatArray:
        """Return the variance (R − 1, C − 1) of the albedo of a window.

        By noise, by the images' parameters, and by slopes that are not what they are taken for.
        """
        sums, rows = self._sums(window)
        equations = eliminate_albedo(sums, self.prior.about(self.albedo[window.cells]))
        equations = equations.with_parameters(window.to_whole)
        common = covariance[np.ix_(rows, rows)]
        by = equations.by_nuisance.reshape(len(rows), -1)
        images = np.sum(by * (common @ by), axis=0).reshape(equations.weight.shape)
        slopes = np.sum(sums.normal[_SLOPES_WITH_ALBEDO, ...] ** 2, axis=0) / equations.weight**2
        return 1.0 / equations.weight + images + self.options.slope_error**2 * slopes


def _at_points(cells: FloatArray, valid: BoolArray) -> FloatArray:
    """Return the means (R, C) of the known cells around each point with a height; else NaN."""
    around = at_cells(np.pad(cells, 1, constant_values=np.nan))
    return np.where(valid, around, np.nan)
