"""Ray tracers behind one interface."""

from urbantwin.lidar.casting.embree import EmbreeCaster
from urbantwin.lidar.casting.hits import Hits, RayCaster

__all__ = ["EmbreeCaster", "Hits", "RayCaster"]
