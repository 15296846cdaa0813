"""Two point clouds aligned."""

from fusion.registration.clouds.align import Alignment, AlignOptions, align_clouds
from fusion.registration.clouds.blur import relative_blur, significant_blur
from fusion.registration.clouds.cloud_grid import grid_cloud
from fusion.registration.clouds.clouds import register_clouds
from fusion.registration.clouds.level import CloudOptions

__all__ = [
    "AlignOptions",
    "Alignment",
    "CloudOptions",
    "align_clouds",
    "grid_cloud",
    "register_clouds",
    "relative_blur",
    "significant_blur",
]
