from .app import create_app as create_app
from .folder import ServedFolder as ServedFolder
from .guard import Entrance as Entrance
from .server import listening as listening
from .server import run_server as run_server
from .service import Limits as Limits
from .service import Service as Service
