"""Options of ``spcola spc lithos``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal, Self

from fusion.pipeline import Subset, find_table
from fusion.workspace.settings import Settings
from fusion.workspace.settings.processing import LithosSettings, RegisterSettings
from spcola.errors import SettingsError
from spcola.photometry.functions import PhotometricFunction, photometric_function
from spcola.photometry.photoclinometry import AlbedoConvention, PhotoclinometryOptions

StartKind = Literal["maplet", "shape"]


class ConstraintKind(StrEnum):
    """Heights that constrain the integration."""

    SHAPE = "shape"
    """Of the solution's shape."""
    OVERLAPS = "overlaps"
    """Of the maplets that overlap, as the parent solution has them, of about the same GSD."""
    COARSER = "coarser"
    """Of coarser ones."""
    LIDAR = "lidar"
    """Of the registered mapolas."""
    RETURNS = "returns"
    """Of the registered returns, each at its own place."""
    LIMBS = "limbs"
    """Of the shape's limbs in images."""
    MAPS = "maps"
    """Of maps and terrain models in files."""


class Purpose(StrEnum):
    """The command that makes the solution."""

    LITHOS = "spcola spc lithos"
    SPCOLA = "spcola fuse --from images"

    @property
    def stem(self) -> str:
        """What names of its solutions begin with."""
        return "lithos" if self is Purpose.LITHOS else "spcola"


@dataclass(frozen=True)
class LithosOptions:
    """What is solved, and how.

    Parameters
    ----------
    subset : Subset
        Maplets that are solved; the others stay as they are.
    start : {"maplet", "shape"}
        Heights and albedo of the first round: the solution's maplet, or its shape with albedo 1.
    constraints : tuple of ConstraintKind
    shape_sigma_m : float, optional
        One standard deviation of the shape's heights, metres. If not given, images show it: the GSD
        of a maplet at most, or a tenth of the side of its facets if that is larger; a fifth of that
        at least.
    maps : tuple of Path
        Files of `MAPS`.
    map_sigma_m : float, optional
        Sigma of their heights where a file states none, metres.
    max_images : int
        Most images of a maplet.
    secondary : tuple of str
        Images that also count where the Sun does not light the ground.
    photoclinometry : PhotoclinometryOptions
        The blur of single images is read later: :func:`fusion.stages.lithos.blurs.with_blurs`.
    accepted : tuple of str
        Codes of findings of the registration that are accepted, where the lidar is asked for.
    purpose : Purpose
    image_blur : str
        Path of a table of the blur of images, relative to the workspace; empty: none.

    Raises
    ------
    SettingsError
        If a value is impossible.
    """

    subset: Subset = field(default_factory=Subset)
    start: StartKind = "maplet"
    constraints: tuple[ConstraintKind, ...] = (ConstraintKind.SHAPE,)
    shape_sigma_m: float | None = None
    maps: tuple[Path, ...] = ()
    map_sigma_m: float | None = None
    max_images: int = 50
    secondary: tuple[str, ...] = ()
    photoclinometry: PhotoclinometryOptions = field(default_factory=PhotoclinometryOptions)
    accepted: tuple[str, ...] = ()
    purpose: Purpose = Purpose.LITHOS
    image_blur: str = ""

    @classmethod
    def of(
        cls,
        settings: Settings,
        subset: Subset,
        *,
        start: StartKind = "maplet",
        constraints: Sequence[str] | None = None,
        maps: Sequence[Path] = (),
        root: Path = Path(),
        purpose: Purpose = Purpose.LITHOS,
    ) -> Self:
        """Return the options of the settings, [lithos] above all.

        Parameters
        ----------
        settings : Settings
        subset : Subset
        start : {"maplet", "shape"}
        constraints : sequence of str, optional
            Kinds; those of the settings if not given.
        maps : sequence of Path
            In addition to those of the settings; they constrain without being asked for.
        root : Path
            To which paths in the settings are relative.
        purpose : Purpose

        Raises
        ------
        SettingsError
            If a value is impossible, or there is no such photometric function.
        """
        table = find_table(settings, LithosSettings)
        asked = {*(table.constraints if constraints is None else constraints)}
        asked |= {ConstraintKind.MAPS} if maps else set()
        return cls(
            subset,
            start,
            tuple(kind for kind in ConstraintKind if kind in asked),
            table.shape_sigma_m or None,
            (*(root / name for name in table.maps), *maps) if ConstraintKind.MAPS in asked else (),
            table.map_sigma_m or None,
            table.max_images,
            tuple(sorted(set(table.secondary_light))),
            PhotoclinometryOptions(
                light_of(settings),
                table.psf_px,
                albedo_sigma=table.albedo_sigma,
                albedo_step_sigma=table.albedo_step_sigma,
                convention=albedo_convention(table),
                slope_sigma=table.slope_sigma,
                independent_start=start == "shape",
                constraint_fraction=table.constraint_fraction,
                seed=table.seed,
                stereo=table.stereo,
                rounds=table.rounds,
            ),
            tuple(settings.accept.codes),
            purpose,
            table.image_blur,
        )

    def __post_init__(self) -> None:
        sigma = self.shape_sigma_m
        if sigma is not None and not (math.isfinite(sigma) and sigma > 0.0):
            raise SettingsError(f"must be positive, not {sigma:g} m", "--shape-sigma")
        if ConstraintKind.MAPS in self.constraints and not self.maps:
            raise SettingsError("names no file", "[lithos] maps", "name some, or give --map FILE")
        if {ConstraintKind.LIDAR, ConstraintKind.RETURNS} <= set(self.constraints):
            raise SettingsError(
                "lidar and returns are the same heights: mapolas are made of the returns",
                "--constraint",
                "choose one of them",
            )

    @property
    def uses_lidar_with_maplets(self) -> bool:
        """Whether both the lidar and maplets of the parent go into the solved ones."""
        asked = set(self.constraints)
        maplets = {ConstraintKind.OVERLAPS, ConstraintKind.COARSER} & asked
        lidar = {ConstraintKind.LIDAR, ConstraintKind.RETURNS} & asked
        return bool(lidar) and (self.start == "maplet" or bool(maplets))

    def as_json(self) -> dict[str, Any]:
        """Return them in JSON types."""
        own = self.photoclinometry
        return {
            **self.subset.as_json(),
            "start": self.start,
            "constraints": [str(one) for one in self.constraints],
            "shape_sigma_m": self.shape_sigma_m,
            "maps": [path.name for path in self.maps],
            "map_sigma_m": self.map_sigma_m,
            "max_images": self.max_images,
            "secondary_light": list(self.secondary),
            "photometry": own.function.text,
            "other_photometry": None
            if own.other_functions is None
            else {one.text: weight for one, weight in own.other_functions},
            "psf_px": own.psf_px,
            "image_blur": own.blurs.as_json(),
            "albedo_sigma": own.albedo_sigma,
            "albedo_step_sigma": own.albedo_step_sigma,
            **convention_json(own.convention),
            "slope_sigma": own.slope_sigma,
            "constraint_fraction": own.constraint_fraction,
            "seed": own.seed,
            "stereo": own.stereo,
            "rounds": own.rounds,
        }


def light_of(settings: Settings) -> PhotometricFunction:
    """Return the photometric function with which maplets are solved: [lithos], else [register].

    Raises
    ------
    SettingsError
        If there is no such function.
    """
    own = find_table(settings, LithosSettings).photometry
    return photometric_function(own or find_table(settings, RegisterSettings).photometry)


def albedo_convention(table: LithosSettings) -> AlbedoConvention:
    """Return how the settings normalise and bound albedo."""
    return AlbedoConvention.published(float(table.albedo_mean), table.albedo_range or math.inf)


def convention_json(convention: AlbedoConvention) -> dict[str, Any]:
    """Return a convention in JSON types."""
    bounded = math.isfinite(convention.range_sigmas)
    return {
        "albedo_mean": convention.mean,
        "albedo_most": convention.most,
        "albedo_range": convention.range_sigmas if bounded else None,
    }
