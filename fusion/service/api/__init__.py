"""The service over HTTP: the application, who may enter, and the limits of requests."""

from fusion.service.api.app import create_app
from fusion.service.api.guard import Entrance
from fusion.service.api.server import listening, run_server
from fusion.service.api.service import STATE_FOLDER, Limits, Service

__all__ = [
    "STATE_FOLDER",
    "Entrance",
    "Limits",
    "Service",
    "create_app",
    "listening",
    "run_server",
]
