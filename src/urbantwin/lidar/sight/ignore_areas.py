"""Areas where labels do not count, because a rig cannot see there.

The counterpart of KITTI's ``DontCare`` boxes: detections and missed objects there are not scored.
Reasons:

- ``outside`` of the region of the twin: its traffic ends there.
- ``far``: beyond the range of every sensor.
- ``unseen``: a surface that faces the sensor would get less than `LEAST_POINTS` points per square
  metre and frame, as behind buildings (`coverage`, "facing").
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.rig import Rig
from urbantwin.lidar.sight.cells import Cells
from urbantwin.lidar.sight.coverage import facing_per_frame

__all__ = ["LEAST_POINTS", "IgnoreArea", "ignore_areas"]

#: Points per square metre and frame, on a surface that faces the sensor.
LEAST_POINTS = 1.0

#: Side of a cell, and of the square (of a car's size) over which points are averaged, metres.
_CELL_M, _SQUARE_M = 1.0, 3.0
#: Extent of ``outside`` beyond the region for a rig on an actor, metres.
_AROUND_M = 250.0
#: Smaller areas are dropped, square metres.
_LEAST_M2 = 2.0


class IgnoreArea(NamedTuple):
    """An area with its reason.

    Attributes:
        reason: ``outside``, ``far`` or ``unseen``.
        area: site frame, metres; polygons only, not empty.
    """

    reason: str
    area: shapely.MultiPolygon


def ignore_areas(
    rig: Rig,
    mesh: LabelledMesh,
    region: shapely.Polygon,
    progress: Callable[[float, str], None] | None = None,
) -> list[IgnoreArea]:
    """Return the areas where labels do not count, one for each reason that occurs.

    Areas of different reasons do not overlap. A rig on an actor sees every place at some time: it
    has ``outside`` only.

    Args:
        rig: the sensors.
        mesh: the static world, site frame.
        region: area of the twin's traffic, site frame.
        progress: called with the fraction done and a description.
    """
    if any(mounted.carrier_SE3_sensor is not None for mounted in rig.sensors):
        around = shapely.box(*region.buffer(_AROUND_M).bounds)
        return _kept({"outside": around.difference(region)})
    discs = shapely.union_all(
        [
            shapely.Point(mounted.site_SE3_sensor.translation[:2]).buffer(
                min(mounted.sensor.assumed_range_max_m, rig.label_range_m or np.inf)
            )
            for mounted in rig.sensors
        ]
    )
    cells, facing = facing_per_frame(rig, mesh, region.bounds, cell_m=_CELL_M, progress=progress)
    points = uniform_filter(facing.astype(np.float64), round(_SQUARE_M / _CELL_M))
    dark = _area_of(points < LEAST_POINTS, cells)
    return _kept(
        {
            "outside": discs.difference(region),
            "far": region.difference(discs),
            "unseen": dark.intersection(region).intersection(discs),
        }
    )


def _area_of(chosen: NDArray[np.bool_], cells: Cells) -> shapely.Geometry:
    """Return the area of chosen cells (ny, nx), merged run by run."""
    edge = np.diff(np.pad(chosen, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(edge == 1)
    _, last = np.nonzero(edge == -1)
    size = cells.size_m
    return shapely.union_all(
        shapely.box(
            cells.x0 + first * size,
            cells.y0 + row * size,
            cells.x0 + last * size,
            cells.y0 + (row + 1) * size,
        )
    )


def _kept(area_of_reason: dict[str, shapely.Geometry]) -> list[IgnoreArea]:
    areas = []
    for reason, area in area_of_reason.items():
        parts = [
            part
            for part in shapely.get_parts(area)
            if part.geom_type == "Polygon" and part.area >= _LEAST_M2
        ]
        if parts:
            areas.append(IgnoreArea(reason, shapely.MultiPolygon(parts)))
    return areas
