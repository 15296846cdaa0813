"""Settings of a blind mission: raw images, nominal kernels, a coarse shape, lidar tables."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

from fusion.truth.presets import FAR_DIVERGENCE, MissionSettings
from lidar.truth import LidarSettings
from spcola.errors import SettingsError, WorkspaceError
from spcola.formats.shapes import read_shape
from spcola.shape import Mesh
from spcola.truth.body import BodySettings
from spcola.truth.campaign import CampaignSettings, PassSettings
from spcola.truth.imaging import ImageSettings
from spcola.truth.raw_frames import DetectorSettings
from spcola.truth.solid import FineSite, RoughShapeSettings, SolidSettings

Part = TypeVar("Part")
# A smaller base, metres, is one in kilometres that was read as metres.
_SMALLEST = 5.0
# Latitude and longitude, degrees: the smooth site, and rough ground.
_SITES = ((-10.0, 350.0), (-45.0, 280.0), (35.0, 65.0), (5.0, 120.0), (70.0, 200.0), (-5.0, 240.0))
LIDAR, IMAGES, KERNELS, SHAPE, CALIBRATION = "lidar", "images", "kernels", "shape", "calibration"
BLIND_PARTS = (LIDAR, IMAGES, KERNELS, SHAPE, CALIBRATION)
"""Folders of a blind mission."""


@dataclass(frozen=True)
class BaseFile:
    """A file with the shape on which the body is built.

    Parameters
    ----------
    path : str
    unit : {"km", "m"}
        Of an OBJ or PLY.
    digest : str
        SHA-256 of its content.
    """

    path: str
    unit: Literal["km", "m"] = "km"
    digest: str = ""

    @classmethod
    def of(cls, path: Path, unit: Literal["km", "m"] = "km") -> BaseFile:
        """Return the reference to an existing file.

        Raises
        ------
        WorkspaceError
            If it cannot be read.
        """
        return cls(str(path.resolve()), unit, _digest(path))

    def mesh(self) -> Mesh:
        """Read the shape.

        Raises
        ------
        WorkspaceError
            If the file is not there, or is another one now.
        FormatError
            If it is no shape.
        """
        if _digest(Path(self.path)) != self.digest:
            raise WorkspaceError(
                "is not the shape on which the mission's body was built", self.path,
                "bring that file back, or make the mission again",
            )  # fmt: skip
        return read_shape(self.path, unit=self.unit)


@dataclass(frozen=True)
class RotationSettings:
    """The rotation of the body in J2000, and the errors of the nominal one.

    Parameters
    ----------
    pole_deg : tuple of 2 float
        Right ascension and declination of the true pole.
    meridian_deg : float
        Angle of the prime meridian at the epoch of the passes.
    pole_error_deg : tuple of 2 float
        Nominal minus true right ascension and declination.
    meridian_error_deg : float
        Nominal minus true angle of the prime meridian in the middle of the images.
    rate_error_deg_per_day : float
        Nominal minus true rate.
    """

    pole_deg: tuple[float, float] = (85.46, -60.36)
    meridian_deg: float = 140.0
    pole_error_deg: tuple[float, float] = (0.02, -0.012)
    meridian_error_deg: float = 0.03
    rate_error_deg_per_day: float = 2.0e-4

    def __post_init__(self) -> None:
        if max(abs(self.pole_deg[1]), abs(self.pole_deg[1] + self.pole_error_deg[1])) > 90.0:
            raise SettingsError("a declination lies beyond a pole", "rotation")


@dataclass(frozen=True)
class BlindSettings(MissionSettings):
    """A mission without an SPC solution, to a body that may overhang.

    The parts of :class:`~fusion.truth.presets.MissionSettings` that belong to a solution are not
    used; of the imaging, photometry, rays and point spread are.

    Parameters
    ----------
    solid : SolidSettings
        The mesh of the body, its overhangs.
    base : BaseFile, optional
        Shape on which it is built.
    detector : DetectorSettings
    rotation : RotationSettings
    rough : RoughShapeSettings
        The coarse shape.
    close_ups : bool
        Whether all frames of the complete detailed survey that show a fine site are taken, in
        addition to the campaign.
    """

    solid: SolidSettings = field(default_factory=SolidSettings)
    base: BaseFile | None = None
    detector: DetectorSettings = field(default_factory=DetectorSettings)
    rotation: RotationSettings = field(default_factory=RotationSettings)
    rough: RoughShapeSettings = field(default_factory=RoughShapeSettings)
    close_ups: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.spc:
            raise SettingsError("there is none in a blind mission", "spc")
        self.solid.check(self.body.radius)

    def with_images(self, images: bool) -> BlindSettings:
        """Return the mission with or without rendered images."""
        return replace(self, images=images)

    def on_base(self, base: BaseFile) -> BlindSettings:
        """Return the mission to a body built on a given shape.

        Distances of the spacecraft, rasters, the mesh and its overhangs follow the size of the
        body; its relief and the errors are unchanged.

        Raises
        ------
        WorkspaceError, FormatError
            If the shape cannot be read.
        SettingsError
            If it is smaller than 5 m.
        """
        radius = round(base.mesh().mean_radius, 3)
        if radius < _SMALLEST:
            raise SettingsError(
                f"has a mean radius of {radius:g} m", base.path, "state its unit with --base-unit"
            )
        factor = radius / self.body.radius
        legs = tuple(
            replace(leg, ranges=(factor * leg.ranges[0], factor * leg.ranges[1]))
            for leg in self.campaign.legs
        )
        solid = _scaled(
            self.solid, factor, "spacing", "smallest", "largest",
            "cliff_length", "cliff_height", "cliff_overhang",
        )  # fmt: skip
        sites = tuple(_scaled(site, factor, "diameter", "spacing") for site in solid.sites)
        return replace(
            self,
            base=base,
            body=replace(self.body, radius=radius),
            solid=replace(solid, sites=sites),
            campaign=replace(self.campaign, legs=legs, radius=radius),
            passes=_scaled(self.passes, factor, "nearest", "farthest"),
            lidar=_scaled(self.lidar, factor, "width", "spacing"),
            rough=_scaled(self.rough, factor, "wavelength"),
        )


def _scaled(settings: Part, factor: float, *names: str) -> Part:
    """Return settings with some lengths multiplied by a factor, to a micrometre."""
    lengths = {name: round(factor * getattr(settings, name), 6) for name in names}
    return cast(Part, replace(cast(Any, settings), **lengths))


def on_base(
    settings: MissionSettings, base: Path | None, unit: Literal["km", "m"] = "km"
) -> MissionSettings:
    """Return the mission to a body built on the shape in a file; as it is without one.

    Raises
    ------
    SettingsError
        If its body has no mesh.
    WorkspaceError, FormatError
        If the shape cannot be read.
    """
    if base is None:
        return settings
    if not isinstance(settings, BlindSettings):
        raise SettingsError("only a blind mission can be built on a given shape", "base")
    return settings.on_base(BaseFile.of(base, unit))


def blind_small(seed: int = 1) -> BlindSettings:
    """Return a blind mission of minutes: 60 m, 78 images of 256², 10 scans."""
    radius = 60.0
    return _blind(
        seed,
        BodySettings(seed=seed, radius=radius),
        SolidSettings(
            spacing=0.4, boulders=8, smallest=4.0, largest=10.0,
            cliffs=1, cliff_length=25.0, cliff_height=5.0, cliff_overhang=3.0,
        ),
        CampaignSettings.of_phases(
            approach=18, preliminary_survey=24, detailed_survey=36, radius=radius, detector=256
        ),
        passes=PassSettings(count=10, days=2),
        lidar=LidarSettings(width=90.0, spacing=0.45, divergence=FAR_DIVERGENCE),
        rough=RoughShapeSettings(q=12, error=0.5, wavelength=35.0, center=0.15),
    )  # fmt: skip


def blind(seed: int = 1) -> BlindSettings:
    """Return a blind mission to a body like Bennu: 375 of 5,069 images of 1024², and close-ups."""
    return replace(_blind_of_bennu(seed, 45, 90, 240), close_ups=True)


def blind_full(seed: int = 1) -> BlindSettings:
    """Return the blind mission with all 5,069 images of Weirich et al., Table 1."""
    return _blind_of_bennu(seed, 927, 877, 3265)


def _blind_of_bennu(seed: int, approach: int, preliminary: int, detailed: int) -> BlindSettings:
    campaign = CampaignSettings.of_phases(
        approach=approach, preliminary_survey=preliminary, detailed_survey=detailed
    )
    return _blind(
        seed,
        BodySettings(seed=seed, shortest=0.06, smallest_rock=0.05),
        SolidSettings(spacing=1.0, sites=tuple(FineSite(*place) for place in _SITES)),
        campaign,
        passes=PassSettings(40, "poles-belt-samples", nearest=900.0, farthest=1100.0),
        lidar=LidarSettings(width=100.0, spacing=0.1),
        rough=RoughShapeSettings(),
    )


def _blind(
    seed: int,
    body: BodySettings,
    solid: SolidSettings,
    campaign: CampaignSettings,
    *,
    passes: PassSettings,
    lidar: LidarSettings,
    rough: RoughShapeSettings,
) -> BlindSettings:
    """Return a blind mission; the reference frame is the body's own."""
    return BlindSettings(
        seed=seed, body=body, passes=passes, lidar=lidar, campaign=campaign, solid=solid,
        imaging=ImageSettings(noise=False, bits=16), image_formats=("fits",), rough=rough,
        epsilon=0.0, rotation_deg=(0.0, 0.0, 0.0), translation_m=(0.0, 0.0, 0.0),
        spc=False, images=True,
    )  # fmt: skip


def _digest(path: Path) -> str:
    """Return the digest of a file."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise WorkspaceError(f"cannot be read ({error.strerror})", path, "name a shape") from error
