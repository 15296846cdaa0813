"""Location of returns on the body: trajectory, pointing, mirror and range offset."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
