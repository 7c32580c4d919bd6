"""Central islands of small roundabouts: raised in a mapped ring, painted at a single node."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.junctions import Ring
from urbantwin.roads.lane_polylines import SurfaceHeight
from urbantwin.roads.model import CURB_HEIGHT_M, MINI_ROUNDABOUT, LaneModel, ModelRoad, RoadArea
from urbantwin.roads.network import Lane, RoadNetwork

__all__ = ["with_central_islands", "with_painted_islands"]

#: Minimum radius of an island (TSRGD 2016, diagram 1003.4: at least 1 m wide), metres.
LEAST_M = 0.5
#: Radius of a painted island (TSRGD 2016, diagram 1003.4: a white circle of 1 to 4 m;
#: FHWA-SA-10-007: mini-roundabouts have a traversable central island), and its maximum distance
#: from the junction, metres.
PAINTED_M, NEAR_M = 2.0, 3.0
#: Number of corners of an outline.
SIDES = 48


def with_central_islands(
    model: LaneModel, network: RoadNetwork, rings: Sequence[Ring], height: SurfaceHeight
) -> tuple[LaneModel, RoadNetwork]:
    """Return model and network with a raised island in the centre of each small roundabout.

    Args:
        model: the lane model, with heights and areas.
        network: its lanes as polylines.
        rings: the small roundabouts.
        height: heights of the road surface.
    """
    areas, lanes = list[RoadArea](), list(network.lanes)
    for ring in rings:
        name = next(
            (j.id for j in network.junctions if j.polygon.contains(shapely.Point(ring.centre))), ""
        )
        through = [lane for lane in lanes if lane.junction == name and lane.kind == "connection"]
        if not name or not through:
            continue
        used = shapely.union_all([lane.polygon for lane in through])
        radius = min(ring.island_radius, float(used.distance(shapely.Point(ring.centre))))
        if radius < LEAST_M:
            continue
        outline = _circle(ring.centre, radius)
        top = height(outline, through[0].level)
        lanes.append(
            Lane(
                id=f"{name}_island",
                road="",
                kind="island",
                width=2.0 * radius,
                speed_limit=0.0,
                centre=np.column_stack([outline, top])[[SIDES // 2, 0]],
                outline=outline,
                level=through[0].level,
                allowed=(),
                successors=(),
                junction=name,
            )
        )
        road = _road_at(model, name)
        if road is not None:
            areas.append(_area(road, outline, top, "trafficIsland", "island", CURB_HEIGHT_M))
    return _with_areas(model, areas), replace(network, lanes=tuple(lanes))


def with_painted_islands(
    model: LaneModel,
    network: RoadNetwork,
    places: NDArray[np.float64],
    height: SurfaceHeight,
) -> LaneModel:
    """Return the model with a painted disc in the centre of each mini-roundabout.

    It is level with the road, and vehicles that cannot go round drive over it.

    Args:
        model: the lane model, with heights and areas.
        network: its lanes as polylines.
        places: (N, 2) positions of the mini-roundabouts, site frame.
        height: heights of the road surface.
    """
    areas = []
    for place in places:
        point = shapely.Point(place)
        candidates = [j for j in network.junctions if j.polygon.distance(point) < NEAR_M]
        junction = min(candidates, key=lambda j: float(j.polygon.distance(point)), default=None)
        road = None if junction is None else _road_at(model, junction.id)
        if junction is not None and road is not None:
            outline = _circle(place, PAINTED_M)
            top = height(outline, junction.level)
            areas.append(_area(road, outline, top, "roadMark", MINI_ROUNDABOUT, 0.0))
    return _with_areas(model, areas)


def _with_areas(model: LaneModel, areas: Sequence[RoadArea]) -> LaneModel:
    first = model.next_id
    numbered = tuple(replace(area, id=first + k) for k, area in enumerate(areas))
    return replace(model, areas=(*model.areas, *numbered))


def _circle(centre: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    around = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    return centre + radius * np.column_stack([np.cos(around), np.sin(around)])


def _road_at(model: LaneModel, name: str) -> ModelRoad | None:
    """Return a connecting road of a junction of the network; ``None`` if there is none."""
    number = next((j.id for j in model.junctions if name in j.members), -2)
    return next((road for road in model.roads if road.junction == number), None)


def _area(
    road: ModelRoad,
    outline: NDArray[np.float64],
    top: NDArray[np.float64],
    kind: str,
    name: str,
    height: float,
) -> RoadArea:
    """Return an outline (N, 2) with heights (N,) as an area of a road, without an id yet."""
    x, y, heading = road.curve.pose(0.0)
    gap, c, s = outline - [x, y], np.cos(heading), np.sin(heading)
    ahead, left = gap[:, 0] * c + gap[:, 1] * s, gap[:, 1] * c - gap[:, 0] * s
    corners = np.column_stack([ahead, left, top - float(road.elevation.at(0.0)[0])])
    return RoadArea(0, road.id, kind, name, 0.0, corners, height)
