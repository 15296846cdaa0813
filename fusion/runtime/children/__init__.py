"""Child processes for items: their death is that of one item's try, not of the program."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
