"""OpenDRIVE out: the lane network as ASAM OpenDRIVE 1.8, and as 1.4 for CARLA."""

from urbantwin.roads.opendrive.write import VERSIONS, opendrive_map, write_opendrive

__all__ = ["VERSIONS", "opendrive_map", "write_opendrive"]
