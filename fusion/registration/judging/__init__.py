"""Whether a registration is accepted: heights that are left over against what chance leaves."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
