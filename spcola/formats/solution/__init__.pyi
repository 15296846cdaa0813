from .lists import read_list as read_list
from .lists import write_list as write_list
from .lmk import read_landmark as read_landmark
from .lmk import write_landmark as write_landmark
from .nom import read_nominal as read_nominal
from .nom import write_nominal as write_nominal
from .sum import read_summary as read_summary
from .sum import write_summary as write_summary
