"""Files of missions: OLA, NLR, LOLA, Hayabusa, Hayabusa2, tracks."""

from lidar.formats.missions.ola import RECORD, write_ola

__all__ = ["RECORD", "write_ola"]
