from .fits import read_fits_dtm as read_fits_dtm
from .fits import write_fits_dtm as write_fits_dtm
from .geotiff import read_geotiff as read_geotiff
from .geotiff import write_geotiff as write_geotiff
from .surface import is_surface as is_surface
from .surface import read_surface as read_surface
from .surface import write_obj as write_obj
from .surface import write_ply as write_ply
