from .catalog import Catalog as Catalog
from .digests import FileDigests as FileDigests
from .digests import file_digest as file_digest
from .records import content_digest as content_digest
from .records import read_record as read_record
from .records import read_records as read_records
from .soundness import unsound as unsound
