from .arcs import Arcs as Arcs
from .returns import Returns as Returns
from .scan import Scan as Scan
from .scan import join as join
from .scan_summary import ScanSummary as ScanSummary
