from .choose import LookOptions as LookOptions
from .choose import look_at as look_at
from .picture import Picture as Picture
from .picture import picture_path as picture_path
from .picture import save_picture as save_picture
