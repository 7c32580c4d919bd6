"""Frames, poses, angles, boxes, areas in plan and labelled triangle meshes, without site data."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.geometry.angle import wrapped
    from urbantwin.geometry.area import (
        area_difference,
        area_intersection,
        area_union,
        areas_of,
        closed,
        grown,
        opened,
    )
    from urbantwin.geometry.box import bounding_box, box_corners, points_in_box
    from urbantwin.geometry.box_overlap import (
        box_footprints,
        box_ious,
        plan_overlaps,
        shared_heights,
    )
    from urbantwin.geometry.frame import SiteFrame
    from urbantwin.geometry.mesh import LabelledMesh
    from urbantwin.geometry.part_colour import PartColours
    from urbantwin.geometry.polyline import moved_left, stations_of_points
    from urbantwin.geometry.pose import Pose, rotation_from_ypr, ypr_from_rotation
    from urbantwin.geometry.probe import DownwardProbe
    from urbantwin.geometry.row_keys import row_keys
    from urbantwin.geometry.smoothing import resampled, smoothed, tightest_bend
    from urbantwin.geometry.surface_material import MaterialLayer, SurfaceMaterials

__all__ = [
    "DownwardProbe",
    "LabelledMesh",
    "MaterialLayer",
    "PartColours",
    "Pose",
    "SiteFrame",
    "SurfaceMaterials",
    "area_difference",
    "area_intersection",
    "area_union",
    "areas_of",
    "bounding_box",
    "box_corners",
    "box_footprints",
    "box_ious",
    "closed",
    "grown",
    "moved_left",
    "opened",
    "plan_overlaps",
    "points_in_box",
    "resampled",
    "rotation_from_ypr",
    "row_keys",
    "shared_heights",
    "smoothed",
    "stations_of_points",
    "tightest_bend",
    "wrapped",
    "ypr_from_rotation",
]

names_on_demand(__name__)
