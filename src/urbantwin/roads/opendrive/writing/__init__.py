"""Writing of a lane model as OpenDRIVE 1.8, or as 1.4 for CARLA."""

from urbantwin.roads.opendrive.writing.write import VERSIONS, write_opendrive

__all__ = ["VERSIONS", "write_opendrive"]
