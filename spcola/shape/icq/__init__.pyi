from .template import IcqEdges as IcqEdges
from .template import IcqShape as IcqShape
from .template import as_icq as as_icq
from .template import distinct_vertices as distinct_vertices
from .template import first_open_edge as first_open_edge
from .template import icq_directions as icq_directions
from .template import label_name as label_name
