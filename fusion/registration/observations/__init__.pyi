from .by_images import ImagedMapolas as ImagedMapolas
from .by_images import place_mapolas as place_mapolas
from .image_registration import ObservationTypes as ObservationTypes
from .image_registration import fit_mapolas as fit_mapolas
from .image_registration import image_registration_json as image_registration_json
from .image_registration import register_with_images as register_with_images
