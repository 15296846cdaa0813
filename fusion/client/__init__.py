"""Workspaces from Python: on a server of ``spcola serve``, or in a folder, by the same calls."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
