"""OpenDRIVE out and in: the lane model as ASAM OpenDRIVE 1.8, and as 1.4 for CARLA."""

from urbantwin.roads.opendrive.placed import placed
from urbantwin.roads.opendrive.read import ReadMap, read_opendrive
from urbantwin.roads.opendrive.write import VERSIONS, write_opendrive

__all__ = ["VERSIONS", "ReadMap", "placed", "read_opendrive", "write_opendrive"]
