"""Coverage of a rig: points per square metre on the ground and above it."""

from urbantwin.lidar.coverage.cells import Cells
from urbantwin.lidar.coverage.ignore_areas import LEAST_POINTS, IgnoreArea, ignore_areas
from urbantwin.lidar.coverage.of_rig import LAYERS, REFLECTIVITY, Coverage, rig_coverage
from urbantwin.lidar.coverage.traverse import BAND_M, LEVEL_M

__all__ = [
    "BAND_M",
    "LAYERS",
    "LEAST_POINTS",
    "LEVEL_M",
    "REFLECTIVITY",
    "Cells",
    "Coverage",
    "IgnoreArea",
    "ignore_areas",
    "rig_coverage",
]
