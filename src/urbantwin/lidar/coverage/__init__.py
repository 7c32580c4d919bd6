"""Where a rig sees how much: points per square metre on the ground and above it."""

from urbantwin.lidar.coverage.cells import Cells
from urbantwin.lidar.coverage.of_rig import LAYERS, REFLECTIVITY, Coverage, rig_coverage
from urbantwin.lidar.coverage.traverse import BAND_M, LEVEL_M

__all__ = ["BAND_M", "LAYERS", "LEVEL_M", "REFLECTIVITY", "Cells", "Coverage", "rig_coverage"]
