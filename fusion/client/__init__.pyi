from .errors import JobFailedError as JobFailedError
from .errors import UnreachableError as UnreachableError
from .errors import VersionWarning as VersionWarning
from .layers import Window as Window
from .sessions import AsyncSession as AsyncSession
from .sessions import Session as Session
from .sessions import connect as connect
from .sessions import connect_async as connect_async
