from .crossings import compare_crossings as compare_crossings
from .places import PlaceCheck as PlaceCheck
from .places import check_place as check_place
from .scanplaces import ScanPlaces as ScanPlaces
from .scanplaces import check_scans as check_scans
