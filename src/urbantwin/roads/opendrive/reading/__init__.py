"""Reading of OpenDRIVE 1.1 to 1.8 as a lane model."""

from urbantwin.roads.opendrive.reading.placement import placed
from urbantwin.roads.opendrive.reading.read import ReadMap, read_opendrive

__all__ = ["ReadMap", "placed", "read_opendrive"]
