from .judging import Evidence as Evidence
from .judging import Limits as Limits
from .judging import judge_registration as judge_registration
from .relief_test import Placed as Placed
from .relief_test import common_relief as common_relief
