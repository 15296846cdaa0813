"""Pictures of files: ``spcola look``, one function for each kind of file."""

from fusion.look.choose import LookOptions, look_at
from fusion.look.picture import Picture, picture_path, save_picture

__all__ = ["LookOptions", "Picture", "look_at", "picture_path", "save_picture"]
