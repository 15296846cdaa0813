"""Common parts of the readers: options, records of bytes and rows, times, and screening."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
