"""Options of ``spcola spc albedo``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, Self

from fusion.pipeline import Subset, find_table
from fusion.stages.lithos.options import albedo_convention, convention_json, light_of
from fusion.stages.tiling.naming import check_letters
from fusion.workspace.settings import Settings
from fusion.workspace.settings.processing import LithosSettings
from spcola.errors import SettingsError
from spcola.photometry.albedo import AlbedoOptions
from spcola.photometry.photoclinometry import PhotoclinometryOptions

GroundKind = Literal["maplets", "mapolas", "bigmaps"]
CentersFrom = Literal["images", "registration"]


@dataclass(frozen=True)
class AlbedoWork:
    """Of what the albedo is solved, and how.

    Parameters
    ----------
    ground : {"maplets", "mapolas", "bigmaps"}
    subset : Subset
        Which of them.
    centers : {"images", "registration"}
        Where mapolas lie: as images show each of them, or as the registration has them.
    letters : str
        First two letters of the names of mapolas as maplets; free ones if empty.
    max_images : int
        Most images of a maplet or mapola, and of the ground of one in a bigmap.
    albedo : AlbedoOptions
        The blur of single images is read later: :func:`fusion.stages.lithos.blurs.with_blurs`.
    accepted : tuple of str
        Codes of findings of the registration that are accepted.
    image_blur : str
        Path of a table of the blur of images, relative to the workspace; empty: none.

    Raises
    ------
    SettingsError
        If the letters are no two letters, or nothing is named by them.
    """

    ground: GroundKind = "maplets"
    subset: Subset = field(default_factory=Subset)
    centers: CentersFrom = "images"
    letters: str = ""
    max_images: int = 50
    albedo: AlbedoOptions = field(default_factory=AlbedoOptions)
    accepted: tuple[str, ...] = ()
    image_blur: str = ""

    @classmethod
    def of(
        cls,
        settings: Settings,
        ground: GroundKind,
        subset: Subset,
        *,
        centers: CentersFrom = "images",
        letters: str = "",
        albedo_sigma: float = 0.2,
        slope_error: float = 0.08,
    ) -> Self:
        """Return the options of the settings, [lithos] above all.

        Parameters
        ----------
        settings : Settings
        ground : {"maplets", "mapolas", "bigmaps"}
        subset : Subset
        centers : {"images", "registration"}
        letters : str
        albedo_sigma : float
            Expected scatter of the relative albedo.
        slope_error : float
            Standard deviation of the slopes of the ground.

        Raises
        ------
        SettingsError
            If a value is impossible, or there is no such photometric function.
        """
        table = find_table(settings, LithosSettings)
        solver = PhotoclinometryOptions(
            light_of(settings),
            table.psf_px,
            albedo_sigma=albedo_sigma,
            convention=albedo_convention(table),
            rounds=table.rounds,
        )
        return cls(
            ground, subset, centers, letters, table.max_images,
            AlbedoOptions(solver, slope_error), tuple(settings.accept.codes), table.image_blur,
        )  # fmt: skip

    def __post_init__(self) -> None:
        if self.letters and self.ground != "mapolas":
            raise SettingsError("only mapolas get new names", "--letters", "give --of mapolas")
        check_letters(self.letters)

    def as_json(self) -> dict[str, Any]:
        """Return them in JSON types, without letters."""
        own = self.albedo.photoclinometry
        return {
            "of": self.ground,
            **self.subset.as_json(),
            "centers": self.centers if self.ground == "mapolas" else None,
            "max_images": self.max_images,
            "photometry": own.function.text,
            "psf_px": own.psf_px,
            "image_blur": own.blurs.as_json(),
            "albedo_sigma": own.albedo_sigma,
            **convention_json(own.convention),
            "slope_error": self.albedo.slope_error,
            "rounds": own.rounds,
        }
