from .gaps import bridged as bridged
from .gaps import bridged_mask as bridged_mask
from .gaps import carried_on as carried_on
from .gaps import closable as closable
from .gaps import closed as closed
from .gaps import filled as filled
from .gaps import plane_of as plane_of
from .gaps import trend_of as trend_of
