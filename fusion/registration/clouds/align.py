"""The transform that takes one cloud of points to another, with its covariance and a verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from fusion.estimation.verdict import Code, Finding, Severity, Verdict
from fusion.registration.clouds.bodies import align_bodies
from fusion.registration.clouds.clouds import register_clouds
from fusion.registration.clouds.composed import composed
from fusion.registration.clouds.flat_frames import flat_frame
from fusion.registration.clouds.level import CloudOptions
from fusion.registration.clouds.not_aligned import NotAlignedError, refusal
from fusion.registration.direct import DirectRegistration
from fusion.registration.search import UNITS
from fusion.registration.transform import PARAMETERS, KnownTransform, Model
from spcola.arrays import FloatArray, check_shape
from spcola.errors import InvalidValueError, NotObservableError, RejectedResultError
from spcola.math import Affine

LEAST_POINTS = 100
"""Fewer points than these are no surface."""

# Thickness of a cloud over its shorter side, below which it is a surface over one plane.
_FLAT = 0.35
# Share of the smaller cloud's longer side that is searched where nothing else is asked for.
_CAPTURE = 0.1
# By so much the sizes of two clouds of one ground may differ: one may see a part of it only.
_SIZES_APART = 30.0
# Two models of one body do not differ by a larger scale, or a smaller one than its inverse.
_SCALES_APART = 1.2
# Units are named where they make the sizes of the clouds agree to this factor.
_UNIT_FITS = 1.25


Ground = Literal["plane", "body"]


@dataclass(frozen=True)
class AlignOptions:
    """How two clouds are aligned.

    Parameters
    ----------
    model : {"rigid", "similarity", "affine"}
    capture_m : float
        Largest displacement that is searched, metres; 0: a tenth of the smaller cloud's size.
    gsd_m : float
        Step of the grids on which clouds are compared, metres (around a body: at least); 0: about
        one point of the sparser cloud in a cell. Not below what the surfaces resolve.
    """

    model: Model = "similarity"
    capture_m: float = 0.0
    gsd_m: float = 0.0


@dataclass(frozen=True, eq=False)
class Alignment:
    """The transform that takes a moving cloud to a fixed one, or why there is none.

    Attributes
    ----------
    model : {"rigid", "similarity", "affine"}
    fit : DirectRegistration or None
        ``V_fixed = translation + matrix · V_moving``; its covariance is about the origin of the
        moving cloud's coordinates, in the order of its ``parameters``. None if there is no
        transform: the findings give the reason.
    verdict : Verdict
        Whether it may be used.
    ground : {"plane", "body"} or None
        Whether the clouds were compared over one plane or in patches around a body.
    """

    model: Model
    fit: DirectRegistration | None
    verdict: Verdict
    ground: Ground | None

    @property
    def registration(self) -> DirectRegistration:
        """The fitted transform.

        Raises
        ------
        RejectedResultError
            If there is none.
        """
        if self.fit is None:
            raise RejectedResultError(f"the alignment is {self.verdict.obstacle(())}")
        return self.fit

    @property
    def transform(self) -> Affine:
        """From the moving cloud's coordinates to the fixed one's, metres."""
        return self.registration.transform

    @property
    def shift(self) -> tuple[FloatArray, FloatArray]:
        """How far the middle of the ground is moved (3,), and its covariance (3, 3); metres.

        The translation alone means little where the origin of the coordinates is far away.
        """
        center = self.registration.center
        moved = self.transform.apply(center) - center
        if not np.isfinite(self.registration.covariance).all():
            return moved, np.full((3, 3), np.nan)
        return moved, _known(self.registration).position_covariance(center[None])[0]

    @property
    def sigma_uncertainty(self) -> float:
        """Relative standard deviation of the sigmas, which come from K parts of the ground.

        A variance that is estimated from K independent parts less P parameters has the relative
        standard deviation √(2 / (K − P)), its root half of that. NaN where there are no sigmas.
        """
        freedom = self.registration.clusters - len(self.registration.parameters)
        return float(1.0 / np.sqrt(2.0 * freedom)) if freedom > 0 else float("nan")

    def as_json(self) -> dict[str, Any]:
        """Return it with the keys of ``registration.json``, as far as they have a meaning here.

        Without a transform the keys are the same, their values null.
        """
        if self.fit is None:
            identity = Affine(np.eye(3), np.zeros(3), "fixed", "moving")
            size = len(PARAMETERS[self.model])
            nothing = DirectRegistration(
                self.model, identity, np.full((size, size), np.nan),
                np.zeros(3), 0.0, 0.0, 0, 0, 0, 0, False,
            )  # fmt: skip
            keys = replace(self, fit=nothing).as_json()
            return {**dict.fromkeys(keys), "model": self.model, **self.verdict.as_json()}
        found = self.fit
        known = _known(found)
        numbers = known.numbers()
        inverse = known.inverse().numbers()
        if not np.isfinite(found.covariance).all():
            for content in (numbers, inverse):
                content.update({key: None for key in content if "sigma" in key})
                content["covariance"] = None
        moved, covariance = self.shift
        return {
            **numbers,
            "center_m": found.center,
            "shift_m": moved,
            "shift_sigma_m": np.sqrt(np.diag(covariance)),
            "sigma_uncertainty": self.sigma_uncertainty,
            "height_residual_std_m": found.residual_std_m,
            "ground": self.ground,
            "points_used": found.points,
            "cells": found.cells,
            "clusters": found.clusters,
            "blur_cells": found.blur_cells,
            "iterations": found.iterations,
            "converged": found.converged,
            "inverse": inverse,
            **self.verdict.as_json(),
        }


def _known(found: DirectRegistration) -> KnownTransform:
    """A transform with its covariance; with none of it where it is not known."""
    known = np.isfinite(found.covariance).all()
    covariance = found.covariance if known else np.zeros_like(found.covariance)
    return KnownTransform(found.model, found.transform, covariance)


def align_clouds(
    moving: FloatArray, fixed: FloatArray, *, options: AlignOptions | None = None
) -> Alignment:
    """Find the transform that takes one cloud of points to another of the same ground.

    Clouds over one plane are gridded and compared on three grids, each finer than the one before
    (:func:`fusion.registration.clouds.register_clouds`); clouds around a body in patches of its
    surface (:func:`fusion.registration.clouds.bodies.align_bodies`). Neither needs points that
    correspond to each other. The covariance follows from the residuals and their correlation.

    Parameters
    ----------
    moving, fixed : (N, 3), (M, 3) ndarrays
        Metres, at least 100 points each. They may lie anywhere.
    options : AlignOptions, optional

    Returns
    -------
    Alignment
        With a verdict. It is refused where the two show no relief in common at the place that was
        found, and without a transform where they do not overlap, lie in different units, or leave a
        parameter free (a plane, a sphere).

    Raises
    ------
    InvalidValueError
        If a cloud has fewer than 100 points, points that are not finite, or no extent.

    Examples
    --------
    >>> import numpy as np
    >>> from fusion.registration.clouds import align_clouds
    >>> x, y = np.random.default_rng(1).uniform(-10, 10, (2, 20_000))
    >>> height = np.sin(x) * np.cos(0.7 * y) + 0.3 * np.sin(2.3 * x + y)
    >>> fixed = np.stack([x, y, height], axis=1)
    >>> found = align_clouds(fixed[::2] + [0.1, 0.0, -0.2], fixed[1::2])
    >>> np.round(found.shift[0], 2) + 0.0
    array([-0.1,  0. ,  0.2])
    >>> found.verdict.judgement
    'accepted'
    """
    options = options or AlignOptions()
    for name, points in (("moving cloud", moving), ("fixed cloud", fixed)):
        _check_cloud(points, name)
    sizes, hint = (_size(moving), _size(fixed)), unit_hint(moving, fixed)
    if not 1.0 / _SIZES_APART < sizes[0] / sizes[1] < _SIZES_APART:
        return _refused(options.model, _sizes_apart(*sizes, hint))
    options = replace(options, capture_m=options.capture_m or _CAPTURE * min(sizes))
    center = np.mean(fixed, axis=0)
    one, two = moving - center, fixed - center
    try:
        found, ground = _aligned(one, two, -center, options)
    except NotObservableError as error:
        frames = _other_frame(one, two, -center, options)
        return _refused(options.model, *_reasons(error, frames, options.capture_m, hint))
    registration = composed(found, Affine(np.eye(3), -center, "centred", "moving"), center)
    verdict = _judged(registration, hint)
    if verdict.judgement == "refused" and ground == "plane":
        verdict = Verdict((*verdict.findings, *_other_frame(one, two, -center, options)))
    return Alignment(options.model, registration, verdict, ground)


def _sizes_apart(moving: float, fixed: float, hint: str) -> Finding:
    text = (
        f"the moving cloud has a size of {moving:.3g} m, the fixed one of {fixed:.3g} m: "
        f"check the units{hint}"
    )
    return Finding(Code.LARGE_SCALE, Severity.REFUSED, text)


def _reasons(
    error: NotObservableError, frames: Sequence[Finding], capture_m: float, hint: str
) -> Iterator[Finding]:
    """Yield the findings of clouds without a transform."""
    yield refusal(error)
    yield from frames
    if error.do is not None and "capture" in error.do:
        searched = f"displacements up to {capture_m:.3g} m were searched"
        yield Finding(Code.NO_OVERLAP, Severity.NOTE, searched)
    if hint:
        yield _sizes_differ(hint)


def _refused(model: Model, *findings: Finding) -> Alignment:
    return Alignment(model, None, Verdict(findings), None)


def _sizes_differ(hint: str) -> Finding:
    return Finding(Code.FITS_OTHERWISE, Severity.NOTE, f"sizes differ{hint}")


def _other_frame(
    moving: FloatArray, fixed: FloatArray, origin: FloatArray, options: AlignOptions
) -> list[Finding]:
    """Return a note if a flat cloud fits with axes exchanged or reversed; nothing otherwise."""
    if not (_is_flat(moving) and _is_flat(fixed)):
        return []
    text = flat_frame(moving, fixed, origin, _cloud_options(options))
    found = f"the moving cloud {text}"
    return [Finding(Code.FITS_OTHERWISE, Severity.NOTE, found)] if text else []


def unit_hint(moving: FloatArray, fixed: FloatArray) -> str:
    """Say in which other unit the moving cloud would be as large as the fixed one; else nothing."""
    ratio = _size(fixed) / _size(moving)
    for factor, text in UNITS.items():
        if factor != 1.0 and abs(np.log(ratio / factor)) < np.log(_UNIT_FITS):
            return f" (times {factor:.4g} the moving one has the fixed one's size: {text}?)"
    return ""


def _check_cloud(points: FloatArray, name: str) -> None:
    """Refuse what is no cloud of enough finite points."""
    check_shape(points, (None, 3), name)
    lost = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
    if lost:
        raise InvalidValueError(f"has {lost} points that are not finite", name, "leave them out")
    if len(points) < LEAST_POINTS:
        raise InvalidValueError(f"has {len(points)} points, {LEAST_POINTS} are needed", name)
    if _size(points) == 0.0:
        raise InvalidValueError("has all its points at one place", name)


def _size(points: FloatArray) -> float:
    """Longest side of the box around the middle nine tenths of a cloud, metres.

    Isolated points far away must not count.
    """
    low, high = np.percentile(points, (5.0, 95.0), axis=0)
    return float(np.max(high - low)) / 0.9


def _is_flat(points: FloatArray) -> bool:
    """Return whether a cloud is a surface over one plane."""
    arms = points - np.median(points, axis=0)
    spans = np.linalg.eigvalsh(arms.T @ arms / len(points))
    return bool(spans[0] < _FLAT**2 * spans[1])


def _aligned(
    moving: FloatArray, fixed: FloatArray, origin: FloatArray, options: AlignOptions
) -> tuple[DirectRegistration, Ground]:
    """Register two clouds over a plane if one of them lies over one, else around a body."""
    if _is_flat(moving) and not _is_flat(fixed):
        near = _near(fixed, moving, options.capture_m, "fixed")
        if _is_flat(near):
            fixed = near
    if not _is_flat(fixed):
        return align_bodies(
            moving, fixed, options.model, origin=origin, gsd_m=options.gsd_m
        ), "body"
    near = _near(moving, fixed, options.capture_m, "moving")
    return register_clouds(near, fixed, options=_cloud_options(options)), "plane"


def _cloud_options(options: AlignOptions) -> CloudOptions:
    return CloudOptions(model=options.model, gsd_m=options.gsd_m, capture_m=options.capture_m)


def _near(points: FloatArray, other: FloatArray, capture: float, name: str) -> FloatArray:
    """Points about a flat cloud: what is elsewhere, such as a body's other side, is left out.

    Raises
    ------
    NotAlignedError
        If hardly any is there.
    """
    middle = other.mean(axis=0)
    axes = np.linalg.eigh((other - middle).T @ (other - middle))[1].T
    low, high = np.percentile(other @ axes.T, (0.5, 99.5), axis=0)
    margin = capture + 0.05 * (high - low)
    along = points @ axes.T
    near = points[np.all((along > low - margin) & (along < high + margin), axis=1)]
    if len(near) < LEAST_POINTS:
        raise NotAlignedError(
            Code.NO_OVERLAP,
            f"the clouds do not overlap: {len(near)} of {len(points)} points of the {name} one lie "
            f"within {capture:.3g} m of the other",
            "check frames and units, or raise the capture range",
        )
    return np.ascontiguousarray(near)


def _judged(found: DirectRegistration, hint: str) -> Verdict:
    """Return the verdict of a registration, with what is known of its covariance and the units."""
    findings = list((found.verdict or Verdict()).findings)
    scale = found.similarity.scale
    if abs(np.log(scale)) > np.log(_SCALES_APART):
        text = f"the scale is {scale:.6g}: one of the two may be in another unit{hint}"
        findings.append(Finding(Code.LARGE_SCALE, Severity.DOUBTFUL, text, scale, _SCALES_APART))
    if not np.isfinite(found.covariance).all():
        text = "the ground has too few independent parts for the transform to have sigmas"
        findings.append(Finding(Code.NOT_DETERMINED, Severity.DOUBTFUL, text))
    if hint and Verdict(tuple(findings)).judgement != "accepted":
        findings.append(_sizes_differ(hint))
    return Verdict(tuple(findings))
