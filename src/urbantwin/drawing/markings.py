"""Paint on the carriageway, for pictures and CARLA: zebras, lane marks, stop lines, arrows.

The twin's mesh has no paint. These are thin sheets slightly above it, at the marks of the lane
model (``roads.marking``).
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import DownwardProbe, LabelledMesh
from urbantwin.roads import RoadNetwork
from urbantwin.roads.marking import painted
from urbantwin.roads.model import LaneModel
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["markings"]

_ABOVE_M = 0.025


def markings(
    network: RoadNetwork, ground: LabelledMesh, model: LaneModel | None = None
) -> LabelledMesh:
    """Return the paint as a mesh in the site frame, metres.

    Args:
        network: the lanes.
        ground: the ground: paint without ground below it is left out.
        model: the lane model; without it only few markings are known.
    """
    corners = painted(network, model).quads
    if not len(corners):
        return LabelledMesh.empty()
    # From 3 m above the lane model, so that a bridge's paint is not put on the street below.
    heights = _heights(network, corners)
    above = np.column_stack([corners.reshape(-1, 2), heights + 3.0])
    z = DownwardProbe(ground).height_below(above)
    vertices = np.column_stack([corners.reshape(-1, 2), z + _ABOVE_M])
    kept = np.isfinite(z).reshape(-1, 4).all(axis=1)
    kept &= np.ptp(np.nan_to_num(z).reshape(-1, 4), axis=1) < 0.5
    first = np.flatnonzero(kept)[:, None, None] * 4
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    corners_of = np.nan_to_num(vertices)[faces]
    area = np.cross(corners_of[:, 1] - corners_of[:, 0], corners_of[:, 2] - corners_of[:, 0])
    faces = faces[np.linalg.norm(area, axis=1) > 1e-9]  # an arrow's triangles are half a quad
    paint = LabelledMesh.build(
        np.nan_to_num(vertices), faces, semantic_id("road"), material_id("road-paint")
    )
    return paint.select(np.ones(len(paint.faces), bool))


def _heights(network: RoadNetwork, corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the height (4 Q,) of the lane centre nearest to each quad."""
    lanes = [lane for lane in network.lanes if len(lane.centre) >= 2]
    tree = shapely.STRtree([shapely.LineString(lane.centre[:, :2]) for lane in lanes])
    nearest = tree.nearest(shapely.points(corners.mean(axis=1)))
    heights = [
        network.height(lanes[number].id, middle)[0]
        for number, middle in zip(nearest, corners.mean(axis=1), strict=True)
    ]
    return np.repeat(heights, 4)
