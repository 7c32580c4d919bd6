"""OpenDRIVE reading and writing: ASAM OpenDRIVE 1.8, and 1.4 for CARLA."""

from urbantwin.roads.opendrive.reading import ReadMap, placed, read_opendrive
from urbantwin.roads.opendrive.writing import VERSIONS, write_opendrive

__all__ = ["VERSIONS", "ReadMap", "placed", "read_opendrive", "write_opendrive"]
