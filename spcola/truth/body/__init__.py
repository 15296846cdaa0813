"""The body: relief, craters, boulders, roughness, albedo."""

from spcola.truth.body.body import TruthBody
from spcola.truth.body.settings import BodySettings
from spcola.truth.body.streams import stream
from spcola.truth.body.surface_points import SurfacePoints
from spcola.truth.body.terrain import BOULDER, CRATER, SMOOTH

__all__ = ["BOULDER", "CRATER", "SMOOTH", "BodySettings", "SurfacePoints", "TruthBody", "stream"]
