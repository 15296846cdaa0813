"""Pictures of images: their pixels, and where landmarks were found and are predicted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion.inspection.file_kinds import summary_path
from fusion.inspection.look.picture import Picture, set_title
from fusion.inspection.look.shapes import smooth_normals
from fusion.report.layout import Colour, styled_figure
from spcola.arrays import AnyArray, FloatArray
from spcola.camera import ImagePoint, SpcImage, project_image, ray
from spcola.errors import FormatError
from spcola.formats.images import open_image, read_fits_image, read_image_data
from spcola.formats.shapes import read_shape
from spcola.formats.solution import read_landmark, read_summary
from spcola.shape import RayCaster

# Residuals are drawn so many times as long, where that makes them visible.
_MAGNIFIED = (1, 2, 5, 10, 20, 50, 100)
# Landmarks are named if they are no more than these.
_NAMED = 40
# Rays along the longer side of a rendered image.
_RAYS = 512
# Of an image of which no pixels are known.
_GREY = 0.35


def image_picture(path: Path) -> Picture:
    """Draw an image from its .SUM, .DAT or FITS file, with its landmarks.

    Landmarks are marked where the .SUM file has them. Where their .LMK files are in the same folder
    or in LMKFILES next to it, residuals to the projected landmarks are drawn as arrows. Without
    pixels the shape in SHAPEFILES, lit by the Sun, stands behind them.

    Raises
    ------
    FormatError
        If a file cannot be read.
    """
    image = _read(path)
    if image is None:
        return _bare_picture(path)
    root = path.absolute().parent.parent
    predicted = _predicted(image, (root / "LMKFILES", path.parent))
    backdrop, what = _backdrop(image, root)
    width, height = image.camera.width, image.camera.height
    with styled_figure(9.6, 9.2 * min(max(height / width, 0.4), 1.4) + 0.9) as figure:
        panel = figure.subplots()
        extent = (0.5, width + 0.5, height + 0.5, 0.5)
        low, high = _stretch(backdrop)
        panel.imshow(backdrop, cmap="gray", vmin=low, vmax=high, extent=extent)
        residuals = _landmarks(panel, image, predicted)
        _directions(panel, image)
        panel.set(xlabel="pixel", ylabel="line", xlim=extent[:2], ylim=extent[2:], aspect="equal")
        set_title(figure, f"{image.name}, image", _caption(image, what, residuals))
    return Picture("image", figure, _facts(image, residuals, what))


def _read(path: Path) -> SpcImage | None:
    """Read an image with its state, and its pixels where they are; None where only pixels are."""
    if path.suffix.lower() == ".sum":
        image = read_summary(path)
        # Next to its folder or, of a solution, in the workspace, whose solutions share the pixels.
        above = (up / "IMAGEFILES" for up in path.absolute().parents[1:4])
        for folder in (path.parent, *above):
            pixels = folder / f"{path.stem}.DAT"
            if pixels.is_file():
                return replace(image, pixels=_pixels(pixels, image))
        return image
    summary = summary_path(path)
    if summary is not None:
        image = read_summary(summary)
        return replace(image, pixels=_pixels(path, image))
    try:
        return read_fits_image(path)
    except FormatError:
        return None


def _pixels(path: Path, image: SpcImage) -> AnyArray:
    if path.suffix.lower() == ".dat":
        return read_image_data(path, image.camera.width, image.camera.height)
    return _pixels_of(path)


def _pixels_of(path: Path) -> AnyArray:
    pixels = open_image(path).read()
    return np.where(pixels.missing, np.nan, pixels.values.astype(np.float64))


def _bare_picture(path: Path) -> Picture:
    """Draw the pixels of an image of which nothing else is known."""
    pixels = _pixels_of(path)
    height, width = pixels.shape
    with styled_figure(9.6, 9.2 * min(max(height / width, 0.4), 1.4) + 0.9) as figure:
        panel = figure.subplots()
        low, high = _stretch(pixels)
        drawn = panel.imshow(
            pixels, cmap="gray", vmin=low, vmax=high, extent=(0.5, width + 0.5, height + 0.5, 0.5)
        )
        figure.colorbar(drawn, ax=panel, shrink=0.8, pad=0.01).set_label("as in the file")
        panel.set(xlabel="pixel", ylabel="line")
        text = f"{width} × {height} pixels; no .SUM file around it, so no landmarks."
        set_title(figure, f"{path.name}, image", text)
    return Picture("image", figure, {"name": path.stem, "pixels": width, "lines": height})


def _predicted(image: SpcImage, folders: tuple[Path, ...]) -> dict[str, FloatArray]:
    """Return pixel and line (2,) at which each landmark of the image is expected, where known."""
    found = {}
    for point in image.landmarks:
        files = [folder / f"{point.name}.LMK" for folder in folders]
        file = next((file for file in files if file.is_file()), None)
        if file is not None:
            found[point.name] = np.array(project_image(image, read_landmark(file).grid.center))
    return found


def _backdrop(image: SpcImage, root: Path) -> tuple[AnyArray, str]:
    """Return the pixels, else a rendering of the shape in SHAPEFILES, else grey; and what it is."""
    if image.pixels is not None:
        return image.pixels, ""
    shapes = [path for path in sorted((root / "SHAPEFILES").glob("[!.]*")) if path.is_file()]
    chosen = next((path for path in shapes if path.name == "SHAPE.TXT"), None)
    chosen = chosen or (shapes[0] if len(shapes) == 1 else None)
    if chosen is None:
        return np.full((2, 2), _GREY), "no pixels, and no shape to render"
    return _rendered(image, chosen), f"no pixels: {chosen.name}, lit by the Sun"


def _rendered(image: SpcImage, shape: Path) -> FloatArray:
    """Return how bright the shape would look in an image, 0 … 1, coarsely; shadows left out."""
    mesh = read_shape(shape)
    step = max(image.camera.width, image.camera.height) / _RAYS
    rows, columns = (max(1, round(n / step)) for n in (image.camera.height, image.camera.width))
    pixel = (np.arange(columns) + 0.5) * image.camera.width / columns + 0.5
    line = (np.arange(rows) + 0.5) * image.camera.height / rows + 0.5
    directions = ray(image, *np.meshgrid(pixel, line)).reshape(-1, 3)
    hits = RayCaster(mesh).cast(image.position, directions)
    light = np.clip(smooth_normals(mesh, hits) @ image.sun, 0.0, 1.0)
    return np.nan_to_num(light).reshape(rows, columns)


def _stretch(pixels: AnyArray) -> tuple[float, float]:
    if pixels.shape == (2, 2):
        return 0.0, 1.0
    known = pixels[np.isfinite(pixels)]
    low, high = (
        (float(part) for part in np.percentile(known, (0.5, 99.7))) if known.size else (0, 1)
    )
    return low, max(high, low + 1e-9)


def _landmarks(panel: Any, image: SpcImage, predicted: dict[str, FloatArray]) -> FloatArray:
    """Mark the landmarks, draw their residuals as arrows, and return these (N, 2), pixels."""
    for points, colour, label in (
        ([p for p in image.landmarks if not p.deweighted], Colour.LIDAR, "landmark"),
        ([p for p in image.landmarks if p.deweighted], Colour.REJECTED, "landmark, down-weighted"),
        (list(image.limbs), Colour.SPC, "limb point"),
    ):
        if points:
            x, y = (np.array([getattr(p, name) for p in points]) for name in ("pixel", "line"))
            panel.scatter(x, y, s=46, facecolors="none", edgecolors=colour, linewidths=1.3,
                          label=f"{label} ({len(points)})")  # fmt: skip
    if len(image.landmarks) <= _NAMED:
        for point in image.landmarks:
            _name(panel, point)
    seen = [point for point in image.landmarks if point.name in predicted]
    residual = np.array([[p.pixel, p.line] - predicted[p.name] for p in seen]).reshape(-1, 2)
    if np.isfinite(residual).any():
        _arrows(panel, seen, residual, max(image.camera.width, image.camera.height))
    if image.landmarks or image.limbs:
        panel.legend(loc="upper right", frameon=True, framealpha=0.85)
    return residual


def _name(panel: Any, point: ImagePoint) -> None:
    panel.annotate(
        point.name, (point.pixel, point.line), xytext=(6, 5), textcoords="offset points",
        fontsize=7, color="white", path_effects=_outline(),
        annotation_clip=True,
    )  # fmt: skip


def _outline() -> list[Any]:
    """A black rim, which makes bright letters readable on bright ground."""
    from matplotlib.patheffects import withStroke  # noqa: PLC0415

    return [withStroke(linewidth=1.6, foreground="black")]


def _arrows(panel: Any, seen: list[ImagePoint], residual: FloatArray, side: int) -> None:
    """Draw found less predicted, magnified so that a typical one is a fiftieth of the image."""
    typical = float(np.sqrt(np.nanmedian(np.sum(residual**2, axis=1))))
    factor = max([f for f in _MAGNIFIED if f * typical <= side / 30.0] or [1])
    x, y = (np.array([getattr(p, name) for p in seen]) for name in ("pixel", "line"))
    drawn = panel.quiver(
        x, y, factor * residual[:, 0], factor * residual[:, 1], color=Colour.LIDAR, angles="xy",
        scale_units="xy", scale=1.0, width=0.0028, zorder=3,
    )  # fmt: skip
    key = float(f"{max(typical, 1e-3):.1g}")
    label = f"found − predicted: {key:g} px" + (f" (× {factor})" if factor > 1 else "")
    shown = panel.quiverkey(drawn, 0.07, 0.03, key * factor, label, labelpos="E",
                            coordinates="axes", color=Colour.LIDAR, labelcolor="white")  # fmt: skip
    shown.text.set_path_effects(_outline())


def _directions(panel: Any, image: SpcImage) -> None:
    """Draw the directions of the Sun and of the body's north as they appear in the image."""
    foot = np.array([0.1, 0.87])
    for vector, text, colour in (
        (image.sun, "Sun", "#ffd24d"),
        (np.array([0, 0, 1.0]), "N", "white"),
    ):
        across, down = image.axes[0] @ vector, image.axes[1] @ vector
        length = float(np.hypot(across, down))
        if length < 0.05:
            continue
        way = np.array([across, -down]) / length * 0.055
        panel.annotate("", foot + way, foot, xycoords="axes fraction", textcoords="axes fraction",
                       arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6})  # fmt: skip
        panel.text(*(foot + 1.45 * way), text, transform=panel.transAxes, color=colour, fontsize=8,
                   weight="bold", ha="center", va="center", path_effects=_outline())  # fmt: skip


def _caption(image: SpcImage, what: str, residuals: FloatArray) -> str:
    distance = float(np.linalg.norm(image.position))
    scale = distance / abs(image.camera.focal_length_mm * image.camera.k_matrix[0, 0])
    parts = [
        f"{image.utc} UTC; {distance:.6g} m from the body's centre, {scale:.3g} m a pixel there"
    ]
    rms, fitted = _rms(residuals), len(residuals)
    if rms is not None:
        parts.append(f"landmarks found less predicted: {rms:.2f} px rms of {fitted}")
    return "; ".join([*parts, what] if what else parts) + "."


def _rms(residuals: FloatArray) -> float | None:
    known = residuals[np.isfinite(residuals).all(axis=1)]
    return float(np.sqrt(np.mean(np.sum(known**2, axis=1)))) if len(known) else None


def _facts(image: SpcImage, residuals: FloatArray, what: str) -> dict[str, Any]:
    """Return what was drawn, for ``--json``."""
    return {
        "name": image.name,
        "utc": image.utc,
        "pixels": image.camera.width,
        "lines": image.camera.height,
        "backdrop": what,
        "landmarks": len(image.landmarks),
        "limbs": len(image.limbs),
        "residual_rms_px": _rms(residuals),
    }
