from .early_exit import INTERRUPTED as INTERRUPTED
from .early_exit import leave_at_once as leave_at_once
from .interrupt import check_interrupts as check_interrupts
from .interrupt import remembering_interrupts as remembering_interrupts
from .isolation import ProcessLimits as ProcessLimits
from .isolation import apply_limits as apply_limits
from .isolation import isolated as isolated
