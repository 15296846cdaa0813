from .item_run import ItemRun as ItemRun
from .parent import end_with_parent as end_with_parent
from .payload import Payload as Payload
from .payload import perform as perform
from .poisonous import PoisonousItemError as PoisonousItemError
from .poisonous import item_name as item_name
from .pool import ProcessExecutor as ProcessExecutor
