"""Pictures of files: ``spcola look``, one function for each type of file."""

from fusion.inspection.look.choose import LookOptions, look_at
from fusion.inspection.look.picture import Picture, picture_path, save_picture
from fusion.inspection.look.shading import limits_of
from fusion.inspection.look.solutions import difference_picture

__all__ = [
    "LookOptions",
    "Picture",
    "difference_picture",
    "limits_of",
    "look_at",
    "picture_path",
    "save_picture",
]
