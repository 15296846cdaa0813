"""What the routes answer: schemas, media types, headers and examples."""

from fusion.service.api.schemas.base import Form, Media, form_of, listing
from fusion.service.api.schemas.description import completed, responses_of

__all__ = ["Form", "Media", "completed", "form_of", "listing", "responses_of"]
