"""Where a pole could stand in a built scene."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import DownwardProbe, LabelledMesh, area_union
from urbantwin.lidar.placement import GROUND_CLASSES
from urbantwin.roads import RoadNetwork
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["pole_places"]

#: Poles are looked for on a grid: so far from the middle of the junction, metres.
_NEAREST_M, _FARTHEST_M, _GRID_M = 8.0, 45.0, 1.5
#: They stand so far from a carriageway: out of the way of mirrors, and still beside the street.
_KERB_M, _BESIDE_M = 0.6, 8.0
#: Nobody walks against them: the middle of a footway is so far, metres.
_FOOTWAY_M = 0.7
#: What a pole can be set in.
_FOOTING = ("sidewalk", "terrain", "other-ground")


def pole_places(
    network: RoadNetwork, region: shapely.Polygon, mesh: LabelledMesh, middle: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where a pole could stand around the middle of a junction.

    On a sidewalk's side or on open ground, beside a carriageway and not on it, under no deck, in
    no water; buildings and trees are not looked at.

    Args:
        network: the lanes.
        region: no pole stands outside.
        mesh: the static world around.
        middle: (2,) of the junction.

    Returns:
        (N, 3) the foot of each pole, site frame, and (N,) how far it is from the carriageway.
    """
    steps = np.arange(-_FARTHEST_M, _FARTHEST_M + _GRID_M / 2, _GRID_M)
    places = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(places, axis=1)
    places = places[(away >= _NEAREST_M) & (away <= _FARTHEST_M)] + middle
    driven = area_union([network.carriageway(level) for level in network.levels])
    walked = [
        shapely.LineString(lane.centre[:, :2])
        for lane in network.lanes
        if lane.kind == "sidewalk" and len(lane.centre) >= 2
    ]
    footways = shapely.union_all(shapely.buffer(np.array(walked, object), _FOOTWAY_M))
    inside = shapely.buffer(region, -1.0)
    shapely.prepare([driven, footways, inside])
    points = shapely.points(places)
    free = shapely.contains(inside, points) & ~shapely.intersects(footways, points)
    free &= shapely.dwithin(driven, points, _BESIDE_M) & ~shapely.dwithin(driven, points, _KERB_M)
    feet = _on_ground(places[free], mesh)
    return feet, shapely.distance(driven, shapely.points(feet[:, :2]))


def _on_ground(places: NDArray[np.float64], mesh: LabelledMesh) -> NDArray[np.float64]:
    """Return the places (N, 2) that are on ground which a pole can be set in, with its height."""
    ground = mesh.select(np.isin(mesh.semantic, [semantic_id(name) for name in GROUND_CLASSES]))
    if not len(places) or not len(ground.faces):
        return np.zeros((0, 3))
    probe = DownwardProbe(ground)
    above = np.column_stack([places, np.full(len(places), ground.vertices[:, 2].max() + 1.0)])
    face = probe.face_below(above)
    firm = np.isin(ground.semantic[face], [semantic_id(name) for name in _FOOTING])
    firm &= (face >= 0) & (ground.material[face] != material_id("water"))
    return np.column_stack([places[firm], probe.height_below(above[firm])])
