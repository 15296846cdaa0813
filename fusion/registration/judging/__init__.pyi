from .common_ground import Placed as Placed
from .common_ground import common_relief as common_relief
from .judging import Evidence as Evidence
from .judging import Limits as Limits
from .judging import judge_registration as judge_registration
from .judging import judge_relief as judge_relief
