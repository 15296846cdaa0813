"""The service over HTTP: the application, who may enter, and the limits of requests."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
