"""Registration: the transform between mapolas and the SPC surface."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fusion.estimation.verdict import Verdict
from fusion.pipeline import Stage, StageContext, StageResult
from fusion.registration.fit import (
    FitOptions,
    LandmarkErrors,
    MatchedMapolas,
    ScanErrorPatterns,
    fit_mapolas,
    share_matrix,
)
from fusion.registration.judging import RegistrationLimits, judge_registration
from fusion.registration.observations import (
    ObservationTypes,
    image_registration_json,
    register_with_images,
)
from fusion.registration.results import (
    GivenRegistration,
    applied_json,
    given_registration,
    registration_json,
    transform_of,
    with_old_keys,
)
from fusion.scene import surface_reference
from fusion.scene.geolocation import ReturnSource, return_paths
from fusion.stages.line_scans import line_scans_not_used
from fusion.stages.register.acceptance import evidence_of, other_frames, unregistered, with_verdict
from fusion.stages.register.imaging import imaged_mapolas, landmark_files
from fusion.stages.register.matching import Matched, check_usable, match_mapolas
from fusion.stages.register.scan_fits import ScanRegistration
from fusion.surfacematch import Match
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.inputs import BodySettings, SpiceSettings, SpinSettings
from fusion.workspace.settings.processing import MapolaSettings, RegisterSettings
from spcola.arrays import FloatArray
from spcola.control.bundle_adjustment import NetworkOptions, solve_network
from spcola.errors import NotObservableError, RejectedResultError, SettingsError
from spcola.shape import Mesh


class RegisterStage(Stage):
    """Mapolas and SPC surface → registration.json."""

    name = "register"
    version = 14
    needs = ("mapolas",)
    places = ("registration.json",)
    tables = (RegisterSettings, BodySettings, MapolaSettings, SpinSettings, SpiceSettings)

    def compares_lidar(self, settings: Settings) -> bool:
        """Return whether mapolas are matched with maplets."""
        return settings.registration.against != "shape"

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why nothing can be registered; empty if it can."""
        if not workspace.mapola_names():
            return f"there are no mapolas; run: spcola mapolas {workspace.root}"
        if settings.registration.against == "shape" and not workspace.has_shape():
            return "there is no shape in SHAPEFILES to register against"
        if settings.registration.against != "shape" and not workspace.maplet_names():
            return 'there are no maplets in MAPFILES; set [register] against = "shape"'
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return mapolas, the SPC surface, its images and landmarks, and a given transform."""
        table = settings.registration
        given = given_path(workspace, table)
        paths = [*workspace.mapola_paths(), *([] if given is None else [given])]
        paths += return_paths(workspace, settings) if table.by == "returns" else []
        shape = table.against == "shape"
        paths += [workspace.shape_path()] if shape else workspace.maplet_files()
        if table.by in ("images", "both"):
            paths += [*workspace.image_files(), *landmark_files(workspace)]
            paths += [workspace.shape_path()] if workspace.has_shape() and not shape else []
        elif table.landmarks != "ignore" and not shape:
            paths += workspace.state_files()
            paths += landmark_files(workspace)
        return paths

    def run(self, context: StageContext) -> StageResult:
        """Match every mapola, fit the transform, judge it.

        A given transform is applied instead of a fit. If none can be fitted, or the registered
        surfaces do not agree, the registration is refused: it is written with its verdict, and no
        stage that needs it runs.
        """
        workspace, table = context.workspace, context.table(RegisterSettings)
        given = _given(workspace, table)
        source = None
        if table.by == "returns" and given is None:
            source = ReturnSource.of(context, workspace.adjustment())
        matched = match_mapolas(context, given, source)
        try:
            content = _registered(context, matched, given, source)
            if given is None and table.by == "topography":
                matched, content, given = _rematched(context, matched, content)
        except NotObservableError as error:
            content, verdict = unregistered(error, matched.matches, table)
        else:
            evidence = evidence_of(context, matched, content, given)
            content["agreement"] = evidence.as_json()
            limits = RegistrationLimits(
                table.max_rotation_deg, table.max_scale_change, table.center_sigma_m
            )
            verdict = judge_registration(content, evidence, limits)
        content["blur_cells"] = matched.blur_cells
        for key, curve in (("noise_spectrum", matched.spectrum), ("transfer", matched.transfer)):
            content[key] = None if curve is None else curve.as_json()
        if verdict.judgement != "accepted":
            content["frame_search"], found = other_frames(context)
            verdict = Verdict((*verdict.findings, *found))
        if context.subset:
            _check_replacement(context, verdict)
        content = with_verdict(content, verdict)
        path = context.write_json(workspace.registration_path.name, with_old_keys(content))
        summary = {k: v for k, v in content.items() if k not in _LONG}
        if table.by in ("images", "both") or table.landmarks != "ignore":
            summary |= line_scans_not_used(workspace)
        return StageResult((path,), summary)


STAGE = RegisterStage()


def _check_replacement(context: StageContext, verdict: Verdict) -> None:
    """Refuse that a trial with some mapolas replaces a registration that may be used.

    Raises
    ------
    RejectedResultError
        If the registration that is there may be used, and the new one may not.
    """
    path, accepted = context.workspace.registration_path, context.settings.accept.codes
    before = context.workspace.find_json(path.name)
    obstacle = verdict.obstacle(accepted)
    if before is None or not obstacle or Verdict.from_json(before).obstacle(accepted):
        return
    raise RejectedResultError(
        f"the registration of these mapolas alone is {obstacle}; the one that was there is kept",
        path,
        "choose more mapolas, or register all of them",
    )


# Rotation of a mapola's edge in cells above which it is matched again from the rotated place, and
# below which the iteration has converged.
_ROTATED_CELLS, _CONVERGED_CELLS = 0.1, 0.01
# Rotations decrease at least by this factor from fit to fit if lidar and SPC show the same surface.
_SLOWEST = 0.7
_MOST_FITS = 8

_LONG = frozenset(
    {
        "per_mapola",
        "per_scan",
        "per_scan_fit",
        "covariance",
        "parameters",
        "noise_spectrum",
        "transfer",
        "stability",
        "inverse",
        "frame_search",
        "images_not_matched",
    }
)


def _registered(
    context: StageContext,
    matched: Matched,
    given: GivenRegistration | None,
    source: ReturnSource | None,
) -> dict[str, Any]:
    """Return the content of the registration by the settings.

    Raises
    ------
    NotObservableError
        If no mapola matches, too few do, or a parameter of the model is not observable.
    """
    workspace, table = context.workspace, context.table(RegisterSettings)
    check_usable(matched.matches, workspace, table.min_coverage)
    if given is not None:
        return _applied(workspace, given, matched, table)
    if table.by in ("images", "both"):
        return _by_images(context, matched)
    return _by_topography(context, matched, source)


def _rematched(
    context: StageContext, matched: Matched, content: dict[str, Any]
) -> tuple[Matched, dict[str, Any], GivenRegistration | None]:
    """Match and fit again from the rotated mapolas, until the rotation no longer changes.

    A match displaces a mapola and does not rotate it. If the transform moves the edge of a mapola
    by a good part of a cell, the matched surfaces are rotated against each other, and the fit
    underestimates the rotation.

    Returns
    -------
    matched, content
        Matches and registration of the last fit.
    given : GivenRegistration or None
        Transform from which the mapolas were matched; None if from their own place.
    """
    workspace, given = context.workspace, None
    grids = {match.name: workspace.mapola(match.name).grid for match in matched.matches}
    reach = max(grid.half_size for grid in grids.values())
    before: FloatArray = np.eye(3)
    last = np.inf
    for _ in range(_MOST_FITS):
        turned = transform_of(content, "registration").nearest_similarity().rotation
        angle = float(np.linalg.norm(Rotation.from_matrix(turned @ before.T).as_rotvec()))
        if angle * reach < (_ROTATED_CELLS if given is None else _CONVERGED_CELLS):
            return matched, content, given
        if angle > _SLOWEST * last:
            break
        last = angle
        given = given_registration({**content, "per_scan": None, "per_mapola": None}, "fit")
        found = match_mapolas(context, given)
        own = [given.referred(match, grids[match.name]) for match in found.matches]
        matched, before = replace(found, matches=own), turned
        content = _registered(context, matched, None, None)
    text = (
        "the rotation does not settle when mapolas are matched again from where the fit turns them"
    )
    return matched, {**content, "converged": False, "reason": text}, given


def _by_topography(
    context: StageContext, matched: Matched, source: ReturnSource | None
) -> dict[str, Any]:
    """Fit the transform to the matches of mapolas or of returns."""
    workspace, table = context.workspace, context.table(RegisterSettings)
    mapolas = _with_landmarks(context, matched.matches)
    options, further = _fit_options(table), []
    if table.against == "shape":
        options = replace(options, fixed_groups=(1,))
        further = [_chords(workspace.shape(), matched.matches)]
    registration = fit_mapolas(mapolas, further, options=options)
    found = registration_json(registration, mapolas, scale_partials=table.against != "shape")
    content = {**found, "by": table.by}
    if source is not None:
        reference = surface_reference(workspace, table.against)
        scans = ScanRegistration(source, reference, registration, matched.blur_cells)
        names = [match.name for match in matched.matches]
        grids = {name: workspace.mapola(name).grid for name in names}
        content["per_scan_fit"] = scans.entries(context, grids)
    return content


def _chords(shape: Mesh, matches: list[Match]) -> FloatArray:
    """Return a shared error (N, 3, 1) of the shape's facets at mapolas, metres: the sagitta.

    Facets may lie below the curved surface by it, or not, which no match separates from a scale.
    """
    centers = np.array([match.center for match in matches])
    outward = centers / np.linalg.norm(centers, axis=1, keepdims=True)
    chords: FloatArray = shape.sagitta * outward[:, :, None]
    return chords


def _by_images(context: StageContext, matched: Matched) -> dict[str, Any]:
    """Fit the transform to matches with images, or to these and matches of heights."""
    workspace, table = context.workspace, context.table(RegisterSettings)
    mapolas = _with_landmarks(context, matched.matches)
    names = [match.name for match in matched.matches]
    grids = [workspace.mapola(name).grid for name in names]
    imaged = imaged_mapolas(context, names, grids)
    by: ObservationTypes = "both" if table.by == "both" else "images"
    found = register_with_images(by, mapolas, imaged, options=_fit_options(table))
    return image_registration_json(by, found, matched.matches, imaged)


def _applied(
    workspace: Workspace, given: GivenRegistration, matched: Matched, table: RegisterSettings
) -> dict[str, Any]:
    """Return the content of the registration by a given transform."""
    own = [given.referred(match, workspace.mapola(match.name).grid) for match in matched.matches]
    mapolas, shares = _with_scans(workspace, own, table)
    content = applied_json(given, mapolas, shares, reject=table.reject_sigmas)
    return {**content, "applied": {"file": table.apply, "inverse": table.inverse}}


def given_path(workspace: Workspace, table: RegisterSettings) -> Path | None:
    """Return the file whose transform is applied; None if one is fitted.

    Errors name the settings or the option, whichever gave the file.

    Raises
    ------
    SettingsError
        If it does not exist, is the output of the stage, or `inverse` is set without a file.
    """
    stated = workspace.settings().registration.apply == table.apply
    where = f"{workspace.root / SETTINGS_FILE}: [register] apply" if stated else "--apply"
    if not table.apply:
        if table.inverse:
            raise SettingsError("names no file, but the inverse is to be applied", where)
        return None
    path = workspace.root / table.apply
    if not path.is_file():
        raise SettingsError(f"names {path}, which is no file", where, "check the path")
    if path.resolve() == workspace.registration_path.resolve():
        raise SettingsError(f"names {path}, which is overwritten", where, "name a copy of it")
    return path


def _given(workspace: Workspace, table: RegisterSettings) -> GivenRegistration | None:
    """Return the transform to apply; None if one is fitted."""
    path = given_path(workspace, table)
    if path is None:
        return None
    return given_registration(
        Workspace(path.parent).read_json(path.name), str(path), inverse=table.inverse
    )


def _fit_options(table: RegisterSettings) -> FitOptions:
    """Return the options of the fit from the settings."""
    return FitOptions(
        model=table.model, center_sigma_m=table.center_sigma_m, reject=table.reject_sigmas
    )


def _with_landmarks(context: StageContext, matches: list[Match]) -> MatchedMapolas:
    """Return matches with the errors of their scans and of the landmarks around them."""
    mapolas, _ = _with_scans(context.workspace, matches, context.table(RegisterSettings))
    return replace(mapolas, landmarks=_landmarks(context, [match.name for match in matches]))


def _landmarks(context: StageContext, names: list[str]) -> LandmarkErrors | None:
    """Return the errors of maplets by landmarks and images; None if the settings ignore them."""
    workspace, table = context.workspace, context.table(RegisterSettings)
    if table.landmarks == "ignore" or table.against == "shape" or not workspace.landmark_names():
        return None
    landmarks = [workspace.landmark(name) for name in workspace.landmark_names()]
    network = solve_network(
        [landmark.name for landmark in landmarks],
        np.array([landmark.grid.center for landmark in landmarks]),
        np.array([landmark.sigma for landmark in landmarks]),
        workspace.images() if table.landmarks == "images" else [],
        options=NetworkOptions(center_sigma=table.center_sigma_m),
    )
    return LandmarkErrors.of_mapolas(network, names, table.center_sigma_m)


def _with_scans(
    workspace: Workspace, matches: list[Match], table: RegisterSettings
) -> tuple[MatchedMapolas, FloatArray]:
    """Return matches with the effects of scan errors, and the shares (N, S) of scans in mapolas.

    The errors are those left by the adjustment of scans, or independent ones of each scan.
    """
    found = [workspace.mapola(match.name).scan_share for match in matches]
    centers = np.array([match.center for match in matches])
    adjustment = workspace.adjustment()
    if adjustment is None:
        names = sorted({name for share in found for name in share})
        shares = share_matrix(found, names)
        scans = ScanErrorPatterns.independent(names, table.scan_sigma_m)
    else:
        shares = share_matrix(found, adjustment.names)
        scans = ScanErrorPatterns.of_adjustment(adjustment, shares, centers)
    return MatchedMapolas.of(matches, scans, shares), shares
