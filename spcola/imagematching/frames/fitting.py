"""The state of an image for which the rendered shape fits the whole frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.camera import SpcImage, project_image, rotate_axes
from spcola.control.estimation import state_partials
from spcola.errors import InvalidValueError, SettingsError
from spcola.grids.correlation import independent_patches
from spcola.imagematching.frames.compare import FrameMatch, block_means
from spcola.imagematching.frames.rendered import RenderedFrame, render_frame
from spcola.math.robust import HUBER, huber_weight, mad
from spcola.photometry.functions import PhotometricFunction, lunar_lambert
from spcola.shape import RayCaster

__all__ = ["FittedFrame", "FrameFitOptions", "fit_frame"]

# Cells along the longer side of a frame, coarse to fine: both pictures are smoothed by this many
# cells first, since facets and their edges are not those of the ground.
_CELLS, _SMOOTHING = (256, 512), 2.0
# Most Gauss–Newton steps of each; the displacement of the ground, cells, at which they end, and
# the largest, pixels, of a last one that has settled: edges of a rendering are rough.
_STEPS, _ENDED, _SETTLED = 8, 0.015, 0.1
_WEIGHINGS = 3
# Fewest cells with brightness: six parameters, gain and offset take eight.
_FEWEST = 100
# Sigma of a position of which none is stated, as a share of the distance.
_POSITION_SHARE = 0.01
# A residual below this share of the brightness, of a rendered frame, is that of rounding.
_ROUNDING = 1e-4
# Area over which errors of cells are taken as common, over that of their correlation.
_REACH = 2.0
# On synthetic bodies, with shapes that lack relief, errors are larger than formal sigmas by this.
_ERROR_FACTOR = 2.0
# Columns of gain and offset after the six of the state.
_STATE, _ALL = 6, 8


@dataclass(frozen=True)
class FrameFitOptions:
    """Settings of :func:`fit_frame`.

    Parameters
    ----------
    function : PhotometricFunction
    position_sigma : float, optional
        Sigma of each coordinate of the position before the fit, metres. If not given, that which
        the image states, or else a hundredth of its distance from the body's centre.

    Raises
    ------
    SettingsError
        If the sigma is not positive.
    """

    function: PhotometricFunction = lunar_lambert
    position_sigma: float | None = None

    def __post_init__(self) -> None:
        sigma = self.position_sigma
        if sigma is not None and not 0.0 < sigma < np.inf:
            raise SettingsError(f"must be positive, not {sigma:g} m", "--position-sigma")


@dataclass(frozen=True, eq=False)
class FittedFrame:
    """An image with the state that fits the shape.

    Parameters
    ----------
    image : SpcImage
        With new position, axes, and sigmas. The sigma of the turns about Cx and Cy is that of
        the ground's place in the image, as :func:`spcola.control.estimation.state_covariance`
        takes it: errors of position and pointing compensate each other there.
    correlation_start, correlation : float
        Of image and rendering at the given and at the new state, cell by cell.
    moved_px : (2,) of float
        Change of pixel and line of the ground in the middle of the body.
    sigma_px : (2,) of float
        One standard deviation of these.
    nearer_m : float
        Change of the distance to the body's centre, metres; negative where the body is larger in
        the image than at the given state.
    roll : float
        Turn about the boresight, radians.
    settled : bool
        Whether the last step hardly moved the ground.
    """

    image: SpcImage
    correlation_start: float
    correlation: float
    moved_px: tuple[float, float]
    sigma_px: tuple[float, float]
    nearer_m: float
    roll: float
    settled: bool


def fit_frame(
    image: SpcImage,
    caster: RayCaster,
    *,
    match: FrameMatch,
    options: FrameFitOptions | None = None,
) -> FittedFrame:
    """Return the state at which the shape looks most like an image: pointing and position.

    Gauss–Newton on the brightness of the frame, ``I = g R(q) + o + error`` with gain and offset as
    nuisances, R the rendering at the state q = (τ1, τ2, τ3, V0), and its change with q that of a
    picture whose points move by their partials [8, 12]. Residuals have Huber's weights, and as many
    cells as are correlated count as one. The position has its stated sigma as prior; pointing has
    none.

    Parameters
    ----------
    image : SpcImage
        With pixels.
    caster : RayCaster
        Of the shape.
    match : FrameMatch
        The offset from which to begin, as :func:`compare_frame` finds it.
    options : FrameFitOptions, optional

    Raises
    ------
    InvalidValueError
        If the image has no pixels, or too little of the lit body is in it.
    """
    if image.pixels is None:
        raise InvalidValueError("has no pixels", image.name, "put its .DAT into IMAGEFILES")
    options = options or FrameFitOptions()
    fit = _Fit.begun(image, caster, match, options)
    moved = np.inf
    for step in dict.fromkeys(max(1, -(-max(image.size) // cells)) for cells in _CELLS):
        for _ in range(_STEPS):
            moved = fit.improve(step)
            if moved < _ENDED * step:
                break
    return fit.result(moved < _SETTLED)


@dataclass(eq=False)
class _Fit:
    """A state that improves step by step."""

    start: SpcImage
    caster: RayCaster
    options: FrameFitOptions
    prior: FloatArray
    anchor: FloatArray
    now: SpcImage
    change: FloatArray
    covariance: FloatArray

    @classmethod
    def begun(
        cls, image: SpcImage, caster: RayCaster, match: FrameMatch, options: FrameFitOptions
    ) -> _Fit:
        """Return the fit at the offset of a match."""
        away = float(np.linalg.norm(image.position))
        given = options.position_sigma
        stated = image.scobj_sigma if given is None else np.full(3, given)
        sigma = np.where(stated > 0.0, stated, _POSITION_SHARE * away)
        rendered = render_frame(caster, image, step=max(1, max(image.size) // min(_CELLS)))
        lit = rendered.brightness > 0.0
        if not lit.any():
            raise InvalidValueError("shows no lit ground at its state", image.name)
        anchor = rendered.points[lit].mean(axis=0)
        turn = np.linalg.solve(state_partials(image, anchor)[:, :2], match.offset)
        change = np.array([*turn, 0.0, 0.0, 0.0, 0.0])
        prior = np.concatenate([np.zeros(3), sigma**-2])
        fit = cls(image, caster, options, prior, anchor, image, np.zeros(6), np.eye(6))
        fit.move(change)
        return fit

    def move(self, change: FloatArray) -> None:
        """Change the state by (τ1, τ2, τ3, δV0)."""
        now = self.now
        axes = rotate_axes(now.axes, change[:3])
        self.now = replace(now, axes=axes, scobj=now.scobj + change[3:])
        self.change = self.change + change

    def improve(self, step: int) -> float:
        """Do a step; return by how much it moves the ground in the image, pixels rms."""
        rendered = render_frame(self.caster, self.now, step=step, function=self.options.function)
        seen = block_means(_pixels(self.now), step)
        one, other = (gaussian_filter(cells, _SMOOTHING) for cells in (seen, rendered.brightness))
        # Sky beyond the blur of both shows nothing of the state.
        used = (other > 0.0) | (one > self.now.thresholds[0])
        if np.count_nonzero(used) < _FEWEST:
            raise InvalidValueError("shows too little lit ground", self.now.name)
        rows, partials = self._rows(rendered, other)
        gain = float(one[used] @ other[used]) / float(other[used] @ other[used])
        change = self._solution(gain * rows[used], one[used] - gain * other[used], used)
        self.move(change)
        moved = partials[used & rendered.body] @ change
        return float(np.sqrt(np.mean(np.sum(moved**2, axis=-1))))

    def _rows(self, rendered: RenderedFrame, smooth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the change (R, C, 8) of expected cells with the state, gain and offset.

        Also that of the places of the ground (R, C, 2, 6) with the state.
        """
        by_line, by_pixel = np.asarray(np.gradient(smooth, float(rendered.step)))
        # Sky next to the limb, into which its blur reaches, moves with the ground next to it.
        row, column = distance_transform_edt(
            ~rendered.body, return_distances=False, return_indices=True
        )
        partials = state_partials(self.now, rendered.points[row, column])
        moved = by_pixel[..., None] * partials[..., 0, :] + by_line[..., None] * partials[..., 1, :]
        layers = [-moved, smooth[..., None], np.ones((*smooth.shape, 1))]
        return np.concatenate(layers, axis=-1), partials

    def _solution(self, rows: FloatArray, residual: FloatArray, used: BoolArray) -> FloatArray:
        """Return the change of the state (6,)."""
        prior = np.concatenate([self.prior, np.zeros(_ALL - _STATE)])
        pull = np.concatenate([self.prior * self.change, np.zeros(_ALL - _STATE)])
        left = residual - np.median(residual)
        scores: FloatArray = np.full(used.shape, np.nan)
        inverse: FloatArray = np.eye(_ALL)
        found, factor = np.zeros(_ALL), 1.0
        least = _ROUNDING * float(np.max(np.abs(rows[:, _STATE])))
        for _ in range(_WEIGHINGS):
            spread = max(float(mad(left)), least)
            scores[used] = np.clip(left / spread, -HUBER, HUBER)
            share = independent_patches(scores) / len(left)
            weight = huber_weight(left / spread) * share / spread**2
            weighted = rows * weight[:, None]
            inverse = _inverse(weighted.T @ rows + np.diag(prior))
            found = inverse @ (weighted.T @ residual - pull)
            left, factor = residual - rows @ found, share / spread
        pulls = np.zeros((*used.shape, _ALL))
        pulls[used] = factor * np.clip(left / spread, -HUBER, HUBER)[:, None] * rows
        middle = _correlated_products(pulls, _REACH * (1.0 / share)) + np.diag(prior)
        covariance = inverse @ middle @ inverse
        self.covariance = _ERROR_FACTOR**2 * covariance[:_STATE, :_STATE]
        return found[:_STATE]

    def result(self, settled: bool) -> FittedFrame:
        """Return the fitted state."""
        start, now = self.start, self.now
        before, after = (np.array(project_image(one, self.anchor)) for one in (start, now))
        partials = state_partials(now, self.anchor)
        placed = np.sqrt(np.diag(partials @ self.covariance @ partials.T))
        sigma = np.sqrt(np.diag(self.covariance))
        angle = float(np.sqrt(np.mean(placed**2))) * now.camera.pixel_angle
        fitted = replace(
            now,
            scobj_sigma=sigma[3:],
            pointing_sigma=np.array([angle, angle, sigma[2]]),
        )
        nearer = float(np.linalg.norm(now.position) - np.linalg.norm(start.position))
        moved = after - before
        return FittedFrame(
            fitted, self._correlation(start), self._correlation(now),
            (float(moved[0]), float(moved[1])), (float(placed[0]), float(placed[1])), nearer,
            float(self.change[2]), settled,
        )  # fmt: skip

    def _correlation(self, image: SpcImage) -> float:
        """Return the correlation of an image with the shape as rendered at its state."""
        step = max(1, -(-max(image.size) // max(_CELLS)))
        rendered = render_frame(self.caster, image, step=step, function=self.options.function)
        seen = block_means(_pixels(image), step)
        return float(np.corrcoef(seen.ravel(), rendered.brightness.ravel())[0, 1])


def _pixels(image: SpcImage) -> AnyArray:
    assert image.pixels is not None
    return np.ascontiguousarray(image.pixels)


def _correlated_products(pulls: FloatArray, cells: float) -> FloatArray:
    """Return the covariance (P, P) of the sum of pulls (R, C, P), correlated between neighbours.

    Errors of the shape are largest at limb and terminator, where the information is: products of
    pulls are summed over neighbours, with a Gaussian kernel over an area of so many cells (Conley
    1999, J. Econometrics 92, 1).
    """
    sigma = float(np.sqrt(cells / (2.0 * np.pi)))
    near = np.stack([gaussian_filter(layer, sigma) for layer in np.moveaxis(pulls, -1, 0)])
    found: FloatArray = cells * np.tensordot(near, pulls, ([1, 2], [0, 1]))
    return (found + found.T) / 2.0


def _inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverse of a positive definite matrix whose units differ widely."""
    scale = np.sqrt(np.diag(matrix))
    found: FloatArray = np.linalg.inv(matrix / np.outer(scale, scale)) / np.outer(scale, scale)
    return found
