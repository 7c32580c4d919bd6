"""Heights of roads: elevation, superelevation, crown, and the one surface that they lie in."""

from urbantwin.roads.heights.heights import with_heights
from urbantwin.roads.heights.surface import RoadSurface

__all__ = ["RoadSurface", "with_heights"]
