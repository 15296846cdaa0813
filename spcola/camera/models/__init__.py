"""Models of lens distortion: one small value each, in a table by name."""

from collections.abc import Mapping
from types import MappingProxyType

from spcola.camera.models.apollo import HASSELBLAD, turned_metric_camera
from spcola.camera.models.brown import BROWN
from spcola.camera.models.model import DistortionForm
from spcola.camera.models.owen import OWEN
from spcola.camera.models.polynomial import BICUBIC, ROSETTA, TRANSVERSE
from spcola.camera.models.radial import HAYABUSA2, LRONAC, OCAMS, RADIAL

MODELS: Mapping[str, DistortionForm] = MappingProxyType(
    {
        "owen": OWEN,
        "brown": BROWN,
        "bicubic": BICUBIC,
        "hasselblad": HASSELBLAD,
        "radial": RADIAL,
        "transverse": TRANSVERSE,
        "rosetta": ROSETTA,
        "hayabusa2": HAYABUSA2,
        "ocams": OCAMS,
        "lronac": LRONAC,
    }
)
"""All models by the names that `Camera.distortion_model` takes."""

__all__ = ["MODELS", "DistortionForm", "turned_metric_camera"]
