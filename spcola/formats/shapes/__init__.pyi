from .icq import read_icq as read_icq
from .icq import write_icq as write_icq
from .obj import FacesFrom as FacesFrom
from .obj import read_obj as read_obj
from .obj import write_obj as write_obj
from .shape import read_shape as read_shape
from .shape import recognise_shape as recognise_shape
