"""The stages of the pipeline, in the order in which the data walk through them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
