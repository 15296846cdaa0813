from .summary import assumed_json as assumed_json
from .summary import per_pair as per_pair
from .summary import per_shot as per_shot
from .summary import place_json as place_json
from .summary import scale_json as scale_json
from .summary import scan_places_json as scan_places_json
from .summary import unobserved_json as unobserved_json
from .summary import unused_pairs as unused_pairs
