from .frames import LeftOut as LeftOut
from .frames import PairFrame as PairFrame
from .frames import PairOptions as PairOptions
from .frames import frame_of_image as frame_of_image
from .frames import pair_size as pair_size
from .frames import seen_from as seen_from
from .placing import LidarPlacement as LidarPlacement
from .sharing import maplet_shares as maplet_shares
