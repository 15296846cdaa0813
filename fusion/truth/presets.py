"""Settings of a synthetic mission, and the named missions."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from lidar.truth import SCAN_FORMATS, LidarSettings, TrackSettings
from spcola.errors import SettingsError
from spcola.math import Similarity
from spcola.truth.body import BodySettings
from spcola.truth.campaign import CampaignSettings, PassSettings
from spcola.truth.campaign.states import StateSettings
from spcola.truth.imaging import IMAGE_FORMATS, ImageSettings
from spcola.truth.solution import SolutionSettings

LIDAR_FRAME, SPC_FRAME = "lidar", "spc"
FAR_DIVERGENCE = 4.0e-5
"""Divergence, rad, for a footprint at 3.5 km as that of OLA at 750 m."""
# The surface of a body reaches no further than this many mean radii.
_CLEAR = 1.25
# SPC's landmark names have six characters, of which two are letters here.
_MOST_MAPLETS = 9999
# Longitude and latitude under the spacecraft, degrees: the south pole, two rings around it of which
# one lacks a scan, and a ring in the north. Nothing lies between 10° and 35° north.
_WITH_GAPS = (
    (90.0, -88.0), (270.0, -80.0),
    *((longitude, -52.0) for longitude in range(20, 380, 72)),
    *((longitude, -15.0) for longitude in range(0, 315, 45)),
    *((longitude, 62.0) for longitude in range(45, 405, 90)),
)  # fmt: skip
# 2019 AUG 05: no spacecraft is at two places.
_AFTER_THE_PASSES = 615_211_269.184 + 35 * 86400.0


def _sixteen_bits() -> ImageSettings:
    """Return exposures at which the brightest spots at opposition do not saturate."""
    return ImageSettings(bits=16, exposure_share=0.55)


def _noise(gsd: float) -> float:
    """Return the rms error of heights, metres, at a GSD above 35 cm: 13 cm at 75 cm.

    Interpolated between the two models of Weirich et al., Table 3.
    """
    return round(0.10 + (0.13 - 0.10) * (gsd - 0.35) / (0.75 - 0.35), 4)


@dataclass(frozen=True)
class MissionSettings:
    """A whole synthetic mission: its body, its errors, and what is planted.

    Parameters
    ----------
    seed : int
        Seed of everything but the body, which has its own.
    body, passes, lidar, solution, states, campaign, imaging
        Settings of the parts.
    tracks : TrackSettings, optional
        Nadir tracks of the lidar, in addition to the rasters of the passes.
    epsilon : float
        All lengths of the SPC solution have to be multiplied by 1 + ε.
    rotation_deg : tuple of 3 float
        Rotation vector from lidar to SPC coordinates, degrees; its third component is the
        difference of the prime meridians.
    translation_m : tuple of 3 float
    day_scale_bias : tuple of float
        Relative bias of all ranges of a day, for each day in turn; empty for none.
    shape_q : int
        Q of the solution's ICQ shape.
    lidar_format : str
        One of :data:`lidar.truth.SCAN_FORMATS`.
    image_formats : tuple of str
        Of :data:`spcola.truth.imaging.IMAGE_FORMATS`.
    spc : bool
        Whether there is an SPC solution, or its shape alone.
    images : bool
        Whether images are rendered; the solution has their states in any case.
    """

    seed: int = 1
    body: BodySettings = field(default_factory=BodySettings)
    passes: PassSettings = field(default_factory=PassSettings)
    lidar: LidarSettings = field(default_factory=LidarSettings)
    tracks: TrackSettings | None = None
    solution: SolutionSettings = field(default_factory=SolutionSettings)
    states: StateSettings = field(default_factory=StateSettings)
    campaign: CampaignSettings = field(default_factory=CampaignSettings)
    imaging: ImageSettings = field(default_factory=_sixteen_bits)
    epsilon: float = 2.5e-4
    rotation_deg: tuple[float, float, float] = (0.006, -0.008, 0.012)
    translation_m: tuple[float, float, float] = (0.07, -0.05, 0.04)
    day_scale_bias: tuple[float, ...] = ()
    shape_q: int = 64
    lidar_format: str = "ola"
    image_formats: tuple[str, ...] = IMAGE_FORMATS
    spc: bool = True
    images: bool = False

    def __post_init__(self) -> None:
        # Values read back from truth.json must be equal to given lists and integers.
        for name in ("rotation_deg", "translation_m", "day_scale_bias"):
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        object.__setattr__(self, "image_formats", tuple(self.image_formats))
        if self.seed < 0:
            raise SettingsError(f"must be at least 0, not {self.seed}", "seed")
        if self.lidar_format not in SCAN_FORMATS:
            known = ", ".join(SCAN_FORMATS)
            raise SettingsError(f"{self.lidar_format!r} is none of {known}", "format of the scans")
        if not set(self.image_formats) <= set(IMAGE_FORMATS):
            raise SettingsError(f"must be of {', '.join(IMAGE_FORMATS)}", "formats of the images")
        if not abs(self.epsilon) < 0.1:
            raise SettingsError(f"must lie within ± 0.1, not {self.epsilon}", "epsilon")
        if self.shape_q < 2:
            raise SettingsError(f"must be at least 2, not {self.shape_q}", "Q of the shape")
        self._check_parts()

    def _check_parts(self) -> None:
        """Refuse parts that contradict each other."""
        places = {"passes.nearest": self.passes.nearest}
        if self.tracks is not None:
            places["tracks.distance"] = self.tracks.distance
            if self.tracks.period != self.passes.period:
                raise SettingsError("must be equal: a body turns once", "tracks and passes: period")
        for name, distance in places.items():
            if distance <= _CLEAR * self.body.radius:
                raise SettingsError(
                    f"{distance:g} m are not clear of a body of {self.body.radius:g} m", name
                )
        if self.spc and self.solution.count(self.body.radius) > _MOST_MAPLETS:
            raise SettingsError(
                f"over {_MOST_MAPLETS}: names have no room for more", "number of maplets",
                "set solution.maplets, or a larger solution.gsd",
            )  # fmt: skip

    @classmethod
    def tiny(cls, seed: int = 1) -> MissionSettings:
        """Return a mission for tests: 40 m, 8 scans, 24 maplets; no gentler errors."""
        return cls(
            seed=seed,
            body=BodySettings(seed=seed, radius=40.0),
            passes=PassSettings(count=8, days=2),
            lidar=LidarSettings(width=60.0, spacing=60.0 / 90, divergence=FAR_DIVERGENCE),
            solution=SolutionSettings(half_size=27, gsd=0.75, maplets=24, noise=_noise(0.75)),
            shape_q=24,
        )

    @classmethod
    def mini(cls, seed: int = 1) -> MissionSettings:
        """Return a small mission: a body of 75 m, 20 scans, 64 maplets, small images."""
        radius = 75.0
        return cls(
            seed=seed,
            body=BodySettings(seed=seed, radius=radius),
            lidar=LidarSettings(width=105.0, spacing=0.42, divergence=FAR_DIVERGENCE),
            solution=SolutionSettings(gsd=0.5, maplets=64, noise=_noise(0.5)),
            campaign=CampaignSettings.of_phases(
                approach=9, preliminary_survey=15, detailed_survey=24, radius=radius, detector=256
            ),
            day_scale_bias=(6e-6, -4e-6, 2e-6, -7e-6, 3e-6),
            images=True,
        )

    @classmethod
    def pole(cls, seed: int = 1) -> MissionSettings:
        """Return the mission of `mini` with the Sun 20° north: the south pole is never lit."""
        mini = cls.mini(seed)
        passes = replace(mini.passes, sun_latitude_deg=20.0)
        return replace(mini, passes=passes, images=False)

    @classmethod
    def demo(cls, seed: int = 1) -> MissionSettings:
        """Return the mission of the demo, in which neither SPC nor lidar sees everything.

        A body of 60 m with 50 maplets. The Sun stands 30° north, so that the south pole is never
        lit, and SPC is wrong or empty there. The scans see that pole, but leave a belt north of
        the equator and a gap south of it.
        """
        radius = 60.0
        return cls(
            seed=seed,
            body=BodySettings(seed=seed, radius=radius),
            passes=PassSettings(directions_deg=_WITH_GAPS, sun_latitude_deg=30.0),
            lidar=LidarSettings(width=52.0, spacing=0.25, divergence=FAR_DIVERGENCE),
            solution=SolutionSettings(gsd=0.6, half_size=40, maplets=50, noise=_noise(0.6)),
            campaign=CampaignSettings.of_phases(
                approach=9, preliminary_survey=15, detailed_survey=24, radius=radius, detector=256
            ),
            day_scale_bias=(6e-6, -4e-6, 2e-6, -7e-6, 3e-6),
            shape_q=48,
        )

    @classmethod
    def bennu(cls, seed: int = 1) -> MissionSettings:
        """Return a mission like that to Bennu: 245 m, 40 scans, maplets of the whole body.

        Scans are 100 m wide, of 2 million shots, from some 1 km: both poles, a belt, samples
        between. Images are 495 of 1024² in 16 bits.
        """
        return cls(
            seed=seed,
            body=BodySettings(seed=seed, smallest_rock=0.05),
            passes=PassSettings(40, "poles-belt-samples", nearest=900.0, farthest=1100.0),
            lidar=LidarSettings(width=100.0, spacing=0.07),
            tracks=TrackSettings(epoch=_AFTER_THE_PASSES),
            campaign=CampaignSettings.of_phases(
                approach=45, preliminary_survey=90, detailed_survey=240
            ),
            day_scale_bias=(2.1e-5, -1.4e-5, 0.7e-5, -2.4e-5, 1.0e-5),
            shape_q=256,
            images=True,
        )

    @classmethod
    def mission(cls, seed: int = 1) -> MissionSettings:
        """Return the lidar of a whole mission: 640 scans of 1.2 million shots, and the SPC shape.

        That many shots over 100 m lie 9 cm apart, not 7 as those of `bennu`.
        """
        bennu = cls.bennu(seed)
        lidar = replace(bennu.lidar, spacing=100.0 / 1100)
        passes = replace(bennu.passes, count=640, pattern="lattice", days=35)
        campaign = CampaignSettings.of_phases()
        return replace(
            bennu,
            passes=passes,
            lidar=lidar,
            campaign=campaign,
            tracks=None,
            spc=False,
            images=False,
        )

    def with_images(self, images: bool) -> MissionSettings:
        """Return the mission with or without rendered images; images need a solution."""
        return replace(self, images=images, spc=self.spc or images)

    @property
    def to_spc(self) -> Similarity:
        """The planted similarity: ``V_spc = T + R V_lidar / (1 + ε)``."""
        return Similarity.from_rotation_vector(
            np.radians(self.rotation_deg),
            self.translation_m,
            1.0 / (1.0 + self.epsilon),
            target=SPC_FRAME,
            source=LIDAR_FRAME,
        )

    @property
    def digest(self) -> str:
        """Hexadecimal digest of all settings: two missions with the same one are the same."""
        text = json.dumps(asdict(self), sort_keys=True)
        return hashlib.sha256(text.encode("utf-8")).hexdigest()
