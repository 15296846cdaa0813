from .align import Alignment as Alignment
from .align import AlignOptions as AlignOptions
from .align import align_clouds as align_clouds
from .cloud_grid import grid_cloud as grid_cloud
from .clouds import CloudOptions as CloudOptions
from .clouds import register_clouds as register_clouds
from .softness import relative_blur as relative_blur
from .softness import significant_blur as significant_blur
