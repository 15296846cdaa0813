"""Folders: made, locked for one program at a time, and cleared of what a killed one left."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
