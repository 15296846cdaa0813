"""From measured stars and a catalogue to the frames of a calibration."""

from __future__ import annotations

from dataclasses import replace

from spcola.arrays import FloatArray
from spcola.camera.camera import Camera
from spcola.camera.stars.calibration import StarFrame
from spcola.camera.stars.catalogue import StarCatalogue, apparent_directions
from spcola.camera.stars.centroids import StarPositions
from spcola.camera.stars.identification import Identified, identify


def identified_frame(
    prior: StarFrame,
    camera: Camera,
    catalogue: StarCatalogue,
    velocity: FloatArray,
    *,
    search_px: float = 50.0,
    match_px: float = 3.0,
) -> tuple[StarFrame, Identified]:
    """Return the identified stars of an image.

    Parameters
    ----------
    prior : StarFrame
        All measured stars of the image and its approximate attitude; its directions are not used.
    camera : Camera
        Nominal.
    catalogue : StarCatalogue
    velocity : (3,) ndarray
        Of the camera, barycentric, m/s: stellar aberration.
    search_px, match_px : float
        See :func:`identify`.

    Raises
    ------
    NotObservableError
        If the stars cannot be identified.
    """
    sky = replace(catalogue, directions=apparent_directions(catalogue.directions, velocity))
    found = identify(camera, prior.axes, prior.stars, sky, search_px=search_px, match_px=match_px)
    stars = prior.stars
    chosen = StarPositions(
        stars.pixel[found.measured],
        stars.line[found.measured],
        stars.covariance[found.measured],
        stars.flux[found.measured],
    )
    # An attitude that is known stays the prior; an approximate one is improved by the match.
    known = prior.attitude_sigma < float("inf")
    axes = prior.axes if known else found.axes
    seen = sky.directions[found.catalogue]
    return StarFrame(prior.name, chosen, seen, axes, prior.attitude_sigma), found
