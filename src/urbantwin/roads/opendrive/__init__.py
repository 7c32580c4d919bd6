"""OpenDRIVE out and in: the lane model as ASAM OpenDRIVE 1.8, and as 1.4 for CARLA."""

from urbantwin.roads.opendrive.write import VERSIONS, write_opendrive

__all__ = ["VERSIONS", "write_opendrive"]
