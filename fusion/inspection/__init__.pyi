from .describe import describe_file as describe_file
from .describe import describe_workspace as describe_workspace
from .forecast import mapolas_forecast as mapolas_forecast
from .foreign import name_content as name_content
