"""The page of the service: where its built files lie, which scripts/page makes from `src`."""

from fusion.service.page.files import STATIC, is_built

__all__ = ["STATIC", "is_built"]
