"""Work of the service: processes that execute jobs, and their supervisor."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
