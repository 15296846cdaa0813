from .catalog import Catalog as Catalog
from .digests import FileDigests as FileDigests
from .file_digest import file_digest as file_digest
from .records import SHARED_STAGES as SHARED_STAGES
from .records import read_record as read_record
from .records import read_records as read_records
from .rows import CATALOG_FILE as CATALOG_FILE
from .written_again import digests_of_written as digests_of_written
