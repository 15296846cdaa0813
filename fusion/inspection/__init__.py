"""Content of a file or a workspace, and time and memory that its stages will take."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
