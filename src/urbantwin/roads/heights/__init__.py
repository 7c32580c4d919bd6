"""Heights of roads: elevation, superelevation, crown, and the common surface of all roads."""

from urbantwin.roads.heights.heights import with_heights
from urbantwin.roads.heights.surface import RoadSurface

__all__ = ["RoadSurface", "with_heights"]
