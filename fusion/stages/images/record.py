"""What the catalogue of images states of each one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from spcola.errors import FormatError


@dataclass(frozen=True)
class PixelFacts:
    """What was written of an image's pixels, and what they contain.

    Parameters
    ----------
    sha256 : str
        Of the .DAT file.
    bits : int
        Of a pixel in the .DAT file.
    thresholds : (2,) of int
        Lowest and highest DN that is used.
    gain, offset : float
        ``DN = gain × value + offset``.
    missing, saturated, below, above : int
        Numbers of pixels, as in :class:`spcola.camera.detector.StoredPixels`.
    lit : float
        Share of pixels at or above the lower threshold.
    brightest : float
        Share of the lit pixels that have the largest DN of the image; 0 if that is below 64.
    edges : float
        Share of the frame's outermost pixels that are lit.
    likeness : float
        Correlation of neighbours along the lines: near 0 for noise.
    columns, lines : float
        Brightness that runs along whole columns (lines) from edge to edge, over that of lit ground.
    """

    sha256: str
    bits: int
    thresholds: tuple[int, int]
    gain: float
    offset: float
    missing: int
    saturated: int
    below: int
    above: int
    lit: float
    brightest: float
    edges: float
    likeness: float
    columns: float
    lines: float


@dataclass(frozen=True)
class ImageRecord:
    """One image of a workspace.

    Parameters
    ----------
    name : str
        In SPC.
    original : str
        Of the product or the file.
    source : str
        The file that was given.
    digest : str
        SHA-256 of the file with the pixels.
    recipe : str
        What was done to the pixels: equal files with equal recipes give equal .DAT files.
    orientation : str
        How the pixels were turned or mirrored (:class:`fusion.stages.images.Turn`).
    size : (2,) of int
        Samples and lines in the .DAT file.
    pixels : PixelFacts
    label : mapping
        Target, instrument, filter, times, … that the label states.
    state : mapping, optional
        Where the state comes from: ``source``, ``from`` and ``solution``; None without a state.
    camera : str, optional
        Where the camera comes from.
    camera_fit : mapping, optional
        Of a camera whose distortion is not Owen's: its ``model``, the camera ``file`` next to the
        .SUM file (empty if none is needed), and how far the .SUM file's camera is from it,
        ``rms_px`` and ``largest_px``.
    notes : tuple of str
        What is doubtful.
    """

    name: str
    original: str
    source: str
    digest: str
    recipe: str
    orientation: str
    size: tuple[int, int]
    pixels: PixelFacts
    label: Mapping[str, Any] = field(default_factory=dict)
    state: Mapping[str, Any] | None = None
    camera: str | None = None
    notes: tuple[str, ...] = ()
    camera_fit: Mapping[str, Any] | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the record in JSON types."""
        content = {**asdict(self), "label": dict(self.label)}
        if self.camera_fit is None:
            del content["camera_fit"]
        return content

    @classmethod
    def from_json(cls, content: Mapping[str, Any], where: str) -> ImageRecord:
        """Return the record of what :meth:`as_json` returned.

        Raises
        ------
        FormatError
            If a field is missing.
        """
        try:
            given = {
                item.name: content[item.name] for item in fields(cls) if item.name != "camera_fit"
            }
            pixels = {item.name: content["pixels"][item.name] for item in fields(PixelFacts)}
        except (KeyError, TypeError) as error:
            raise FormatError(
                f"is no record of an image ({error})", where, "import the images again"
            ) from error
        pixels["thresholds"] = tuple(pixels["thresholds"])
        made = {"pixels": PixelFacts(**pixels), "size": tuple(given["size"])}
        made |= {"notes": tuple(given["notes"]), "camera_fit": content.get("camera_fit")}
        return cls(**{**given, **made})
