from .catalog import Catalog as Catalog
from .digests import FileDigests as FileDigests
from .digests import file_digest as file_digest
from .records import SHARED_STAGES as SHARED_STAGES
from .records import read_record as read_record
from .records import read_records as read_records
from .soundness import unsound as unsound
from .written_again import with_known_states as with_known_states
