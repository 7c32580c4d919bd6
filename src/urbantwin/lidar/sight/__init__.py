"""Visibility: what the sensors of a rig see of ground cells, targets and their junction.

`line_of_sight` casts straight lines, `expected_points` beams with the full return model. Coverage,
placement, labels and the viewer use these two only.
"""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.lidar.sight.cells import BAND_M, LEVEL_M, Cells
    from urbantwin.lidar.sight.coverage import LAYERS, REFLECTIVITY, Coverage, rig_coverage
    from urbantwin.lidar.sight.expected_points import ExpectedPoints
    from urbantwin.lidar.sight.field_of_view import FieldOfView
    from urbantwin.lidar.sight.ground import CELL_M
    from urbantwin.lidar.sight.ignore_areas import LEAST_POINTS, IgnoreArea, ignore_areas
    from urbantwin.lidar.sight.line_of_sight import LineOfSight
    from urbantwin.lidar.sight.rig_sight import RigSight, SensorSight, sight_of_rig
    from urbantwin.lidar.sight.stand import (
        place_in_sight,
        stand_in_sight,
        standing_rig,
        warnings_of_place,
    )

__all__ = [
    "BAND_M",
    "CELL_M",
    "LAYERS",
    "LEAST_POINTS",
    "LEVEL_M",
    "REFLECTIVITY",
    "Cells",
    "Coverage",
    "ExpectedPoints",
    "FieldOfView",
    "IgnoreArea",
    "LineOfSight",
    "RigSight",
    "SensorSight",
    "ignore_areas",
    "place_in_sight",
    "rig_coverage",
    "sight_of_rig",
    "stand_in_sight",
    "standing_rig",
    "warnings_of_place",
]

names_on_demand(__name__)
