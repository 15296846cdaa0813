"""Files of missions: OLA, NLR, LOLA, Hayabusa, Hayabusa2, tracks."""

from lidar.formats.missions.ola import OLA_RECORD, write_ola

__all__ = ["OLA_RECORD", "write_ola"]
