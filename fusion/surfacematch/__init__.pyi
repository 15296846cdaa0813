from .displacing import BORDER as BORDER
from .displacing import spline_of as spline_of
from .match import Match as Match
from .match import MatchOptions as MatchOptions
from .match import Surface as Surface
from .match import match_surfaces as match_surfaces
from .match import unmatched as unmatched
from .weights import BEST_SHARE as BEST_SHARE
