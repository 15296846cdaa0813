"""The files of a blind mission: raw images, calibration frames, kernels, coarse shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from fusion.truth.blind.plan import BlindImage, BlindPlan, plan_blind
from fusion.truth.blind.settings import CALIBRATION, IMAGES, KERNELS, SHAPE, BlindSettings
from fusion.truth.work import Work, missing
from spcola.formats.shapes import write_obj_mesh
from spcola.truth.imaging import render_image
from spcola.truth.kernels import write_pointing, write_positions, write_texts
from spcola.truth.raw_frames import Detector, RawLabel, write_calibration, write_raw_image
from spcola.truth.solid import SolidBody, rough_shape

ROUGH_SHAPE = "rough.obj"
"""Name of the coarse shape."""


def write_blind(
    work: Work, settings: BlindSettings, body: SolidBody
) -> tuple[dict[str, BlindImage], dict[str, Any]]:
    """Write all but the scans; return the images by name, and what else is planted.

    There is nothing of an SPC solution among the files.
    """
    plan = plan_blind(settings)
    shape = _write_shape(work, settings, body)
    _write_kernels(work, settings, plan)
    detectors = _write_calibration(work, settings)
    if settings.images:
        _write_images(work, body, plan, detectors)
    images = {image.truth.name: image for image in plan.images}
    return images, {
        "images": {name: image.planted() for name, image in images.items()},
        "rotation": {"true": asdict(plan.spin), "nominal": asdict(plan.nominal_spin)},
        "sun_j2000": plan.sun.tolist(),
        "rough_shape": shape,
        "overhangs": [feature.described() for feature in body.overhangs],
    }


def _write_shape(work: Work, settings: BlindSettings, body: SolidBody) -> dict[str, float]:
    """Write the coarse shape; return how far its vertices are from the truth, metres."""
    shape = rough_shape(body.outermost_radius, settings.rough, work.random("rough shape"))
    mesh = shape.mesh()
    if missing(path := work.site.root / SHAPE / ROUGH_SHAPE):
        write_obj_mesh(path, mesh)
    away = body.nearest(mesh.vertices).distance
    return {
        "mean_m": float(np.mean(away)),
        "rms_m": float(np.sqrt(np.mean(away**2))),
        "largest_m": float(np.max(np.abs(away))),
    }


def _write_kernels(work: Work, settings: BlindSettings, plan: BlindPlan) -> None:
    folder = work.site.root / KERNELS
    cameras = {image.label.camera: image.truth.camera for image in plan.images}
    clock, _ = write_texts(
        folder, cameras, plan.nominal_spin, plan.clock, settings.body.radius
    )  # fmt: skip
    states = [image.state for image in plan.images]
    if states:
        # They have the times of their making in them: files of the same states are not rewritten.
        if missing(path := folder / "blind.bsp"):
            write_positions(path, states, plan.sun)
        if missing(path := folder / "blind.bc"):
            write_pointing(path, states, clock)


def _write_calibration(work: Work, settings: BlindSettings) -> dict[str, Detector]:
    """Write dark current and flat field of each camera; return the detectors."""
    size = settings.campaign.detector
    detectors = {}
    for camera in ("MapCam", "PolyCam"):
        generator = work.random(f"detector {camera}")
        detectors[camera] = Detector.drawn(settings.detector, camera, size, generator)
        write_calibration(work.site.root / CALIBRATION, detectors[camera])
    return detectors


def _write_images(
    work: Work, body: SolidBody, plan: BlindPlan, detectors: Mapping[str, Detector]
) -> None:
    folder = work.site.root / IMAGES
    wanted = [image for image in plan.images if missing(folder / f"{image.truth.name}.fits")]
    with work.progress.task("images", len(plan.images)) as task:
        task.advance(len(plan.images) - len(wanted))
        for _ in work.executor.stream(partial(_write_image, work, body, detectors), wanted):
            task.advance()


def _write_image(
    work: Work, body: SolidBody, detectors: Mapping[str, Detector], image: BlindImage
) -> None:
    """Render one image with its true state, and write the raw frame."""
    generator = work.random(f"image {image.truth.name}")
    rendered = render_image(
        body.surface, body, image.truth, settings=work.settings.imaging, generator=generator
    )
    label: RawLabel = image.label
    detector = detectors[label.camera]
    pixels = detector.frame(
        rendered.iof,
        exposure=label.exposure,
        temperature_c=label.temperature_c,
        generator=generator,
    )
    path = work.site.root / IMAGES / f"{image.truth.name}.fits"
    write_raw_image(path, pixels, label, detector)
