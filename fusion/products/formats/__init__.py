"""FITS, GeoTIFF, OBJ and PLY of fused surfaces."""

from fusion.products.formats.fits import read_fits_dtm, write_fits_dtm
from fusion.products.formats.geotiff import read_geotiff, write_geotiff
from fusion.products.formats.surface import is_surface, read_surface, write_obj, write_ply
from fusion.products.formats.terrain_raster import TerrainRaster

__all__ = [
    "TerrainRaster",
    "is_surface",
    "read_fits_dtm",
    "read_geotiff",
    "read_surface",
    "write_fits_dtm",
    "write_geotiff",
    "write_obj",
    "write_ply",
]
