from .by_images import ImagedMapolas as ImagedMapolas
from .by_images import place_mapolas as place_mapolas
from .kinds import Kind as Kind
from .kinds import fit_mapolas as fit_mapolas
from .kinds import kinds_json as kinds_json
from .kinds import register_kinds as register_kinds
from .landmarks import LandmarkErrors as LandmarkErrors
