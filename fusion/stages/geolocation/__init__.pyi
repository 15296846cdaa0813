from .locating import located_store as located_store
from .return_source import ReturnSource as ReturnSource
from .return_source import gridding_options as gridding_options
